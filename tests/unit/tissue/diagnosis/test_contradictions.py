"""Names must agree with their own parameters: what contradicts itself is not named."""

from dataclasses import replace

import numpy as np
import pytest
from fine_tissue import branch, experiment
from periodic_records import multisine, relaxing_force

from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, add, fit_base, shape_bounds
from lumbar.tissue.diagnosis.fitting.preparation import prepare
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.selection.candidate import contradictions
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure


def form(effect: str, name: str):
    return next(item for item in TISSUE[effect].forms if item.name == name)


def relaxing(time, position, speed, step):
    return 1.2 * position + 0.8 * branch(position, 0.3, step)


def softening_spring(time, position, speed, step):
    return relaxing(time, position, speed, step) - 0.02 * position**3


def shaken(time, position, speed, step):
    return relaxing(time, position, speed, step) + 0.2 * np.sin(2 * np.pi * 1.373 * time)


def clipped(time, position, speed, step):
    return np.clip(relaxing(time, position, speed, step), -2.0, 2.0)


@pytest.fixture(scope="module")
def linear():
    return prepare(experiment(relaxing))


@pytest.fixture(scope="module")
def base(linear) -> Fit:
    return fit_base(Structure(BASES["KB"]), linear.training)


def with_size(fit: Fit, effect: str, name: str, value: float) -> Fit:
    """The same fit with another value of one nonlinear parameter."""
    position = len(fit.structure.base.nonlinear)
    nonlinear = fit.nonlinear.copy()
    names = [item.name for item in form(effect, fit.structure.forms[0].name).nonlinear]
    nonlinear[position + names.index(name)] = value
    return replace(fit, nonlinear=nonlinear)


def test_a_model_of_what_is_there_does_not_contradict_itself(linear, base):
    assert contradictions(base, linear) == []
    there = {"coulomb_friction": lambda t, x, v, h: relaxing(t, x, v, h) + 0.3 * np.tanh(v / 0.5)}
    for effect, truth in {**there, "saturation": clipped, "periodic_disturbance": shaken}.items():
        prepared = prepare(experiment(truth))
        fit = add(
            fit_base(Structure(BASES["KB"]), prepared.training), TISSUE[effect].forms[0], prepared.training
        )
        assert contradictions(fit, prepared) == []


@pytest.mark.parametrize(
    ("effect", "name"), [("coulomb_friction", "coulomb"), ("hardening_stiffness", "cubic"), ("inertia", None)]
)
def test_a_force_whose_interval_holds_zero_is_not_there(linear, base, effect, name):
    added = TISSUE[effect].forms[0] if name is None else form(effect, name)
    fit = add(base, added, linear.training)
    (size,) = (item.name for item in added.linear)
    assert contradictions(replace(fit, linear=np.append(fit.linear[:-1], 1e-7)), linear) == [
        f"{effect}: the interval of {size} holds 0"
    ]


def test_two_forces_that_are_alike_are_there_together():
    """Beyond all speeds of the record a breakaway is like dry friction: neither is sure alone, their sum is."""
    prepared = prepare(experiment(lambda t, x, v, h: relaxing(t, x, v, h) + 0.3 * np.tanh(v / 0.5)))
    stribeck = next(item for item in TISSUE["coulomb_friction"].forms if len(item.linear) == 2)
    fit = add(fit_base(Structure(BASES["KB"]), prepared.training), stribeck, prepared.training)
    alike = with_size(
        replace(fit, linear=np.append(fit.linear[:2], [0.2, 0.1])),
        "coulomb_friction",
        "stribeck_speed",
        300.0,
    )
    alike = with_size(alike, "coulomb_friction", "smoothing_speed", 0.5)
    amplitudes = estimates(alike, prepared.training, "mm", "N")[2:4]
    assert all(item.low <= 0 for item in amplitudes)
    assert contradictions(alike, prepared) == []
    without = replace(alike, linear=np.append(alike.linear[:2], [1e-7, 1e-7]))
    assert contradictions(without, prepared) == [
        "coulomb_friction: the interval of coulomb_force, breakaway_excess holds 0"
    ]


def test_a_base_of_which_nothing_is_left_is_told(linear, base):
    gone = replace(base, linear=np.zeros(2))
    assert contradictions(gone, linear) == ["nothing is left of KB: all its stiffnesses are 0"]


@pytest.mark.parametrize(
    ("effect", "name", "parameter"),
    [("backlash", "play", "half_gap"), ("delay", "pure", "delay"), ("softening", "time", "time_constant")],
)
@pytest.mark.parametrize("end", [0, 1])
def test_a_decisive_parameter_at_the_end_of_its_range_is_told(linear, base, effect, name, parameter, end):
    fit = add(base, form(effect, name), linear.training)
    bound = shape_bounds(fit.structure, linear.training, fit.nonlinear)[end][-1]
    told = contradictions(with_size(fit, effect, parameter, bound), linear)
    assert f"{effect}: {parameter} is at the end of its range" in told


@pytest.mark.parametrize(
    ("effect", "name", "words"),
    [
        ("saturation", "sharp", "of the samples lie above its limit"),
        ("saturation", "soft", "of the samples lie above its limit"),
        ("contact_loss", "sharp", "of the samples pull more than its limit"),
        ("contact_loss", "soft", "of the samples pull more than its limit"),
    ],
)
def test_a_limit_that_the_record_exceeds_is_refused(linear, base, effect, name, words):
    fit = add(base, form(effect, name), linear.training)
    force = linear.training.force
    limit = 0.5 * np.abs(force).max()
    above = force < -limit if effect == "contact_loss" else np.abs(force) > limit
    assert np.mean(above) > 0.02
    told = contradictions(with_size(fit, effect, "limit", limit), linear)
    assert any(item.startswith(f"{effect}: ") and item.endswith(words) for item in told)


def test_a_limit_counts_from_the_sensors_zero():
    """Forces up to 2 N about a zero of 5 N lie at 7 N: a limit of 2 N is none that they exceed."""
    prepared = prepare(experiment(clipped, zeros=(5.0, 5.0)))
    fit = add(
        fit_base(Structure(BASES["KB"]), prepared.training), form("saturation", "sharp"), prepared.training
    )
    assert fit.zero == pytest.approx(5.0, abs=0.01)
    assert fit.nonlinear[-1] == pytest.approx(2.0, rel=0.01)
    assert contradictions(fit, prepared) == []


@pytest.mark.parametrize("name", ["sine", "overtones"])
@pytest.mark.parametrize(
    ("frequency", "period", "words"),
    [
        (0.079, None, "its record holds 1.9 cycles of it"),
        (0.084, None, "its record holds 2.0 cycles of it"),
        (0.22, None, ""),
        (0.5, 4.0, "it repeats with the excitation"),
        (0.51, 4.0, "it repeats with the excitation"),
        (0.53, 4.0, ""),
        (1.375, 4.0, ""),
        (0.5, None, ""),
    ],
)
def test_a_disturbance_needs_five_cycles_and_a_clock_of_its_own(name, frequency, period, words):
    """A record of 24 s has lines 0.042 Hz apart; half of one beside the excitation's grid is the least."""
    motion = Motion(np.arange(1201) * 0.02, np.zeros(1201), 0.02)
    refuses = form("periodic_disturbance", name).contradiction
    assert refuses({"frequency": frequency}, motion, np.zeros(1201), 0.01, period) == words


def test_fewer_cycles_are_enough_of_a_line_that_stands_out():
    """A sine of two to five cycles is one; a zero that wanders has its strongest line there too, and is none."""
    disturbance, random = form("periodic_disturbance", "sine"), np.random.default_rng(0)
    for seed in range(8):
        position = multisine(8, seed=seed)
        motion = Motion(0.01 * np.arange(len(position)), position, 0.01)
        force = relaxing_force(position) + 0.02 * random.standard_normal(len(position))
        walk = np.cumsum(random.standard_normal(len(position)))
        walk *= 0.3 / np.std(walk)
        power = np.abs(np.fft.rfft((walk - walk.mean()) * np.hanning(len(walk)))) ** 2
        strongest = (2 + np.argmax(power[2:5]) + 0.1) / motion.time[-1]
        wanders = disturbance.contradiction({"frequency": strongest}, motion, force + walk, 0.02, None)
        assert "cycles of it" in wanders
        for cycles in (2.2, 3.0, 4.5):
            frequency = cycles / motion.time[-1]
            sine = 0.1 * np.sin(2 * np.pi * frequency * motion.time + seed)
            assert not disturbance.contradiction({"frequency": frequency}, motion, force + sine, 0.02, None)


def test_a_spring_that_gets_softer_is_not_called_hardening():
    for effect, names in (
        ("hardening_stiffness", ("cubic", "bilinear")),
        ("strain_softening", ("cubic", "bilinear")),
    ):
        assert all(item.sign > 0 for name in names for item in form(effect, name).linear)
    found = diagnose(experiment(softening_spring))
    assert (found.verdict, found.selected) == ("named", ("strain_softening",))
    lost = {item.name: item.value for item in found.ranking[0].estimates}
    assert lost["cubic_stiffness_lost"] == pytest.approx(0.02, rel=0.02)


def test_a_rhythm_of_the_excitation_is_not_called_a_disturbance():
    """A force that a square of the position makes repeats with the excitation, whatever else could tell it."""

    def bent(time, position, speed, step):
        return relaxing(time, position, speed, step) + 0.3 * np.abs(np.sin(2 * position))

    catalogue = {name: TISSUE[name] for name in ("periodic_disturbance", "drift")}
    found = diagnose(experiment(bent), DiagnosisSettings(catalogue=catalogue))
    assert (found.verdict, found.selected) == ("unexplained", ())
