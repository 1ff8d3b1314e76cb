"""Models that a force drives: against linear systems, an adaptive solver, and the forces of the same motions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.driven_motion import POINTS, ForceBalance, ForceDrive, can_be_simulated
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.measured_motion import MEASURED, for_base, smooth_angle
from lumbar.tissue.models.model_data import FittedParameter, Port
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import ForwardStructure, Structure

FORMS = {form.key: form for effect in TISSUE.values() for form in effect.forms if can_be_simulated(form)}
STEP = 0.01
TIME = STEP * np.arange(1001)
MASS, STIFFNESS, VISCOSITY = 0.02, 1.0, 0.05


def force(time):
    return np.sin(2 * np.pi * 0.7 * time) + 0.8 * np.sin(2 * np.pi * 2.3 * time + 1)


def driven(*keys, values):
    """Drive of the second-order base with forms, and its parameters."""
    balance = ForceBalance((BASES["KV-mass"].form, *(FORMS[key] for key in keys)))
    at_points = force(TIME[:-1, None] + STEP * POINTS)
    parameters = dict(zip(balance.parameters, (MASS, STIFFNESS, VISCOSITY, *values), strict=True))
    return ForceDrive(balance, at_points, STEP, 1.0), parameters


def reference(friction, *state_rates):
    """Position under the force and a friction, with the rates of further states, by an adaptive solver."""

    def rates(time, y):
        push = force(time) - STIFFNESS * y[0] - VISCOSITY * y[1] - friction(y)
        return [y[1], push / MASS, *(rate(y) for rate in state_rates)]

    settings = {"t_eval": TIME, "rtol": 1e-9, "atol": 1e-11, "max_step": STEP, "method": "LSODA"}
    return solve_ivp(rates, (0, TIME[-1]), np.zeros(2 + len(state_rates)), **settings).y[0]


ALPHA, BETA, GAMMA, DELTA = 5.0, 1.7, 0.8, -1.1
"""Bouc and Wen's own numbers: ṙ = αv − β(γ|v|r + δv|r|)."""
GENERAL = (ALPHA / (2 * BETA * GAMMA), 1 / (2 * BETA * GAMMA), (GAMMA - DELTA) / (2 * GAMMA))
REFERENCES = {
    "coulomb_friction/coulomb": ((0.5, 1.0), (lambda y: 0.5 * np.tanh(y[1]),), 1e-5),
    "hysteresis/bouc_wen": (
        (0.8, 0.3),
        (lambda y: 0.8 * y[2], lambda y: y[1] / 0.3 * (1 - max(y[2] * np.sign(y[1]), 0) ** 2)),
        1e-3,
    ),
    "hysteresis/bouc_wen_general": (
        GENERAL,
        (
            lambda y: y[2],
            lambda y: ALPHA * y[1] - BETA * (GAMMA * abs(y[1]) * y[2] + DELTA * y[1] * abs(y[2])),
        ),
        1e-3,
    ),
}
"""Parameters, friction and rates of states, and error allowed: the step matters at a kink of the force."""


@pytest.mark.parametrize("key", REFERENCES)
def test_motions_match_adaptive_solver(key):
    values, friction, allowed = REFERENCES[key]
    drive, parameters = driven(key, values=values)
    result = drive.motion(parameters, np.zeros(1 + len(friction)))
    np.testing.assert_allclose(result.position, reference(*friction), atol=allowed)


def test_sticking_friction_matches_adaptive_solver():
    """A slope of 50 N s/mm against a dashpot of 0.05: Newton's method alternates, and must not give up."""
    drive, parameters = driven("coulomb_friction/coulomb", values=(0.5, 0.01))
    sticking = reference(lambda y: 0.5 * np.tanh(y[1] / 0.01))
    np.testing.assert_allclose(drive.motion(parameters, np.zeros(2)).position, sticking, atol=0.02)
    smooth = reference(lambda y: 0.5 * np.tanh(y[1]))
    assert np.abs(sticking - smooth).max() > 0.1, "or smooth friction would pass as well"


@pytest.mark.parametrize("key", ["hardening_stiffness/exponential", "hysteresis/bouc_wen"])
def test_sensitivities_match_differences_of_motions(key):
    drive, parameters = driven(key, values=(0.5, 0.4))
    start = np.zeros(2 + len(drive.balance.states))
    result = drive.motion(parameters, start)
    slopes = drive.sensitivities(
        parameters, result, [(name, 1e-6 * value) for name, value in parameters.items()], True
    )
    for column, (name, value) in enumerate(parameters.items()):
        changed = ({**parameters, name: value * (1 + sign * 1e-5)} for sign in (1, -1))
        more, less = (drive.motion(item, start, result.points).position for item in changed)
        difference = (more - less) / (2e-5 * value)
        np.testing.assert_allclose(slopes[:, column], difference, atol=1e-4 * np.abs(difference).max())
    moved = drive.motion(parameters, start + 1e-5 * np.eye(len(start))[0], result.points).position
    by_start = slopes[:, len(parameters)]
    np.testing.assert_allclose(by_start, (moved - result.position) / 1e-5, atol=1e-3 * np.abs(by_start).max())


COMPLIANCES = {
    "LE": ([2.0], [], ([1.0], [2.0])),
    "KV": ([2.0, 0.3], [], ([1.0], [0.3, 2.0])),
    "KV-mass": ([0.02, 2.0, 0.3], [], ([1.0], [0.02, 0.3, 2.0])),
    "KB": ([2.0, 3.0], [0.1], ([0.1, 1.0], [0.5, 2.0])),
    "Maxwell": ([3.0], [0.1], ([0.1, 1.0], [0.3, 0.0])),
    "KB-mass": ([0.02, 2.0, 3.0], [0.1], ([0.1, 1.0], [0.002, 0.02, 0.5, 2.0])),
}
"""Linear and nonlinear parameters, and position over force in s."""


@pytest.mark.parametrize("name", COMPLIANCES)
def test_bases_match_linear_systems(name):
    linear, nonlinear, system = COMPLIANCES[name]
    drive = np.sin(2 * np.pi * 0.7 * TIME) ** 3
    if name == "LE":
        expected = drive / 2
    else:
        fine = np.arange(0, TIME[-1] + 1e-9, STEP / 20)
        expected = lsim(system, np.sin(2 * np.pi * 0.7 * fine) ** 3, fine)[1][::20]
    result = ForwardStructure(BASES[name]).simulate(
        Motion(TIME, drive, STEP), np.array(linear), np.array(nonlinear)
    )
    np.testing.assert_allclose(result, expected, atol=2e-4 * np.abs(expected).max())


def smooth_motion():
    """A motion that begins at rest, with its force to come."""
    rise = 1 - np.exp(-((TIME / 0.4) ** 4))
    return Motion(
        TIME, rise * (0.8 * np.sin(2 * np.pi * 0.9 * TIME) + 0.3 * np.sin(2 * np.pi * 2.1 * TIME + 1)), STEP
    )


@pytest.mark.parametrize("key", FORMS)
def test_forward_simulation_recovers_motion(key):
    """From motion to force by the closed forms, from force to motion by simulation: the same equation both ways."""
    form, motion = FORMS[key], smooth_motion()
    scales = [1.0 if item.scale == "force" else motion.scale(item.scale) for item in form.nonlinear]
    middles = [np.sqrt(item.low * item.high) for item in form.nonlinear]
    nonlinear = np.multiply(middles, scales)
    columns = np.stack(form.columns(motion, nonlinear), axis=1)
    linear = 0.2 / np.maximum(np.abs(columns).max(axis=0), 1e-9) / len(form.linear)
    base = [MASS, STIFFNESS, VISCOSITY]
    structure = Structure(BASES["KV-mass"], (form,))
    force = structure.simulate(motion, np.array([*base, *linear]), nonlinear)
    result = ForwardStructure(BASES["KV-mass"], (form,)).simulate(
        Motion(TIME, force, STEP), np.array([*base, *linear]), nonlinear
    )
    np.testing.assert_allclose(result, motion.position, atol=0.01 * np.abs(motion.position).max())


def test_start_is_estimated_from_measured_motion():
    """A record that begins in the middle of a motion: without its state the simulation begins at rest."""
    drive, parameters = driven("hardening_stiffness/cubic", values=(0.5,))
    whole = drive.motion(parameters, np.zeros(2)).position
    late = 137
    motion = Motion(TIME[: len(TIME) - late], force(TIME[late:]), STEP)
    seen = Motion(motion.time, motion.position, STEP, channels={MEASURED: whole[late:] + 0.3})
    structure = ForwardStructure(BASES["KV-mass"], (FORMS["hardening_stiffness/cubic"],))
    linear = np.array([MASS, STIFFNESS, VISCOSITY, 0.5])
    error = structure.simulate(seen, linear, np.zeros(0), zero=0.3) - whole[late:]
    assert np.abs(error).max() < 0.003
    assert np.abs(structure.simulate(motion, linear, np.zeros(0)) - whole[late:]).max() > 0.1


def test_delayed_force_delays_motion():
    """The motion of a delayed force is the delayed motion."""
    delay = TISSUE["delay"].forms[0]
    motion = Motion(TIME, np.sin(2 * np.pi * 0.7 * TIME) ** 3, STEP)
    linear, late = np.array([MASS, STIFFNESS, VISCOSITY]), 7 * STEP
    plain = ForwardStructure(BASES["KV-mass"]).simulate(motion, linear, np.zeros(0))
    result = ForwardStructure(BASES["KV-mass"], (delay,)).simulate(motion, linear, np.array([late]))
    np.testing.assert_allclose(result[7:], plain[:-7], atol=1e-5)


@pytest.mark.parametrize("name", ["KV-mass", "KB-mass"])
def test_bases_with_a_mass_as_transfer_functions(name):
    linear, nonlinear, (above, below) = COMPLIANCES[name]
    base = BASES[name]
    values = [*zip(base.linear, linear, strict=True), *zip(base.nonlinear, nonlinear, strict=True)]
    parameters = tuple(FittedParameter(item.name, "", "", value) for item, value in values)
    model = FittedModel(
        name, Structure(base), STEP, Port("position", "mm"), Port("force", "N"), name, parameters=parameters
    )
    s = 2j * np.pi * 1.3
    assert complex(model.to_control()(s)) == pytest.approx(
        np.polyval(below, s) / np.polyval(above, s), rel=1e-9
    )


SWING_TIME = np.arange(3000) * STEP
LINES = np.array([0.13, 0.4, 0.75, 1.1, 1.5])
SIZES = np.array([0.3, 0.2, 0.15, 0.08, 0.05])


def record(noise=0.0, decimals=None):
    angle = np.sin(2 * np.pi * np.outer(SWING_TIME, LINES)) @ SIZES
    angle = angle + noise * np.random.default_rng(1).standard_normal(len(SWING_TIME))
    angle = angle if decimals is None else np.round(angle, decimals)
    channels = {"input": Channel(angle, "angle", "rad"), "output": Channel(angle, "moment", "N m")}
    return Record("swing", SWING_TIME, channels)


def acceleration_error(item):
    exact = -np.sin(2 * np.pi * np.outer(SWING_TIME, LINES)) @ (SIZES * (2 * np.pi * LINES) ** 2)
    return np.sqrt(np.mean((Motion.from_record(item).acceleration - exact)[50:] ** 2))


FAULTS = [
    ("decimals", 6, 2e-3),
    ("decimals", 4, 0.03),
    ("decimals", 3, 0.15),
    ("noise", 1e-4, 0.06),
    ("noise", 1e-3, 0.3),
]


@pytest.mark.parametrize(("fault", "size", "allowed"), FAULTS)
def test_smooth_angle_keeps_noise_out_of_acceleration(fault, size, allowed):
    measured = record(**{fault: size})
    assert acceleration_error(smooth_angle(measured)) < allowed
    assert acceleration_error(smooth_angle(measured)) < 0.2 * acceleration_error(measured)


def test_angle_in_degrees_is_rejected():
    in_degrees = record()
    values = np.degrees(in_degrees["input"])
    channels = {**in_degrees.channels, "input": Channel(values, "angle", "rad")}
    with pytest.raises(InputError, match=r"swing: .*\brad\b.*\bscale: 0\.0174533.*lifting\.moment_layout"):
        for_base(Record("swing", SWING_TIME, channels), BASES["pendulum"])


def test_only_angle_of_pendulum_is_smoothed():
    rough = record(noise=1e-3)
    assert for_base(rough, BASES["KB"]) is rough
    made = for_base(rough, BASES["pendulum"])
    assert made["input"] is not rough["input"]
    assert made["output"] is rough["output"]
