"""The pendulum and its effects against Newton's law for point masses (`lumbar.twin.hip_moment`)."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import PENDULUM, TISSUE, catalogue_with
from lumbar.tissue.effects.hooks import interval_starts
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure
from lumbar.twin.hip_moment import Mass, Swing, acceleration, constant, rate

FORMS = {form.key: form for effect in PENDULUM.values() for form in effect.forms}
TIME = np.arange(2000) * 0.01
MASS, LENGTH, CENTRAL, DAMPING = 40.0, 0.4, 2.0, 6.0
AWAY_FROM_ENDS = slice(50, -50)


def angle(time):
    return 0.1 + 0.5 * np.sin(2 * np.pi * 0.3 * time) + 0.2 * np.cos(2 * np.pi * 0.71 * time)


def stretched(time):
    return LENGTH + 0.06 * np.sin(2 * np.pi * 0.43 * time + 1)


def pivot_x(time):
    return 0.03 * np.sin(2 * np.pi * 0.6 * time)


def pivot_z(time):
    return 0.02 * np.cos(2 * np.pi * 0.5 * time)


CHANNELS = {
    "box_held": (TIME > 4) * (TIME < 12) * 1.0,
    "length": stretched(TIME),
    "pivot_acceleration_x": acceleration(pivot_x, TIME),
    "pivot_acceleration_z": acceleration(pivot_z, TIME),
}
MOTION = Motion(TIME, angle(TIME), 0.01, channels=CHANNELS)


def newton(hanging=True, length=None, central=CENTRAL, box=None, pivot=None, gravity=9.81):
    """Moment of the swing by Newton's law, with its viscous damping."""
    masses = (Mass(MASS, length or constant(LENGTH)), *((box,) if box else ()))
    moving = {"pivot_x": pivot[0], "pivot_z": pivot[1]} if pivot else {}
    swing = Swing(angle, masses, central, hanging, **moving, gravity=gravity)
    return swing.moment(TIME) + DAMPING * rate(angle, TIME)


def base_linear(sign, inertia=CENTRAL + MASS * LENGTH**2, gravity=MASS * 9.81 * LENGTH):
    return [inertia, DAMPING, sign * gravity]


def assert_close(moment, expected):
    assert np.abs(moment - expected)[AWAY_FROM_ENDS].max() < 2e-6 * np.abs(expected).max()


SIGNS = pytest.mark.parametrize(("name", "sign"), [("hanging", 1.0), ("inverted", -1.0)])


def simulated(key, linear, nonlinear=(), base=None, sign=1.0, forms=FORMS):
    structure = Structure(BASES["pendulum"], (forms[key],) if key else ())
    everything = np.array([*(base or base_linear(sign)), *linear])
    return structure.simulate(MOTION, everything, np.array(nonlinear))


@SIGNS
def test_base_is_the_rigid_pendulum(name, sign):
    assert_close(simulated("", [], sign=sign), newton(name == "hanging"))


@SIGNS
@pytest.mark.parametrize("gravity", [9.81, 1.62])
def test_box_and_varying_length_follow_gravity(name, sign, gravity):
    """The length has its Coriolis term."""
    hanging, catalogue = name == "hanging", catalogue_with([], "pendulum", gravity)
    forms = {form.key: form for item in catalogue.values() for form in item.forms}
    box = Mass(15.0, constant(0.5), lambda time: (time > 4) * (time < 12) * 1.0)
    base = base_linear(sign, gravity=MASS * gravity * LENGTH)
    moment = simulated(f"hand_load/measured_{name}", [15.0], [0.5], base, forms=forms)
    assert_close(moment, newton(hanging, box=box, gravity=gravity))
    guessed = simulated(f"hand_load/interval_{name}", [15.0], [0.5, 4.0, 12.0], base, forms=forms)
    settled = (np.abs(TIME - 4) > 0.1) & (np.abs(TIME - 12) > 0.1)
    assert np.allclose(guessed[settled], moment[settled], atol=1e-9)
    key, base = f"variable_length/measured_{name}", base_linear(sign, CENTRAL, 0.0)
    assert_close(simulated(key, [MASS], (), base, forms=forms), newton(hanging, stretched, gravity=gravity))


def test_gravity_must_be_positive():
    with pytest.raises(InputError, match=r"gravity_m_s2 .*\b0\b.*m/s²"):
        catalogue_with([], "pendulum", 0.0)
    assert catalogue_with([], "KB", 0.0) == TISSUE
    assert catalogue_with([], "pendulum") == PENDULUM


def test_length_in_proportion_to_the_angle():
    share = 0.3
    moment = simulated(
        "variable_length/linear_in_angle",
        [2 * MASS * LENGTH**2 * share, MASS * LENGTH**2 * share**2, MASS * 9.81 * LENGTH * share],
    )
    assert_close(moment, newton(length=lambda time: LENGTH * (1 + share * angle(time))))


@pytest.mark.parametrize("share", [1e-4, -1e-4])
def test_first_order_forms_match_newton(share):
    """Half of the difference between a change and its opposite has no second order."""

    def difference(change):
        def length(direction):
            return lambda time: LENGTH * (1 + direction * share * change(time))

        return (newton(length=length(1)) - newton(length=length(-1))) / 2 / share

    inertia, gravity = MASS * LENGTH**2, MASS * 9.81 * LENGTH
    squared = FORMS["variable_length/quadratic_in_angle"].columns(MOTION, np.zeros(0))
    assert_close(
        np.stack(squared, axis=1) @ [2 * inertia, gravity], difference(lambda time: angle(time) ** 2)
    )
    turning = FORMS["variable_length/oscillating"].columns(MOTION, np.array([0.4]))
    for phase, chosen in ((0.0, [2 * inertia, 0, gravity, 0]), (np.pi / 2, [0, 2 * inertia, 0, gravity])):
        expected = difference(lambda time, phase=phase: np.sin(2 * np.pi * 0.4 * time + phase))
        assert_close(np.stack(turning, axis=1) @ chosen, expected)


@SIGNS
def test_moving_pivot(name, sign):
    hanging, first_moment = name == "hanging", MASS * LENGTH
    both = simulated(f"moving_pivot/measured_{name}", [first_moment], sign=sign)
    assert_close(both, newton(hanging, pivot=(pivot_x, pivot_z)))
    along = simulated("moving_pivot/measured_horizontal", [first_moment], sign=sign)
    assert_close(along, newton(hanging, pivot=(pivot_x, constant(0.0))))
    up = simulated("moving_pivot/measured_vertical", [sign * first_moment], sign=sign)
    assert_close(up, newton(hanging, pivot=(constant(0.0), pivot_z)))
    largest = -first_moment * 0.03 * (2 * np.pi * 0.6) ** 2
    swaying = simulated("moving_pivot/swaying", [largest, 0.0], [0.6], sign=sign)
    assert_close(swaying, along)
    largest = -sign * first_moment * 0.02 * (2 * np.pi * 0.5) ** 2
    heaving = simulated("moving_pivot/heaving", [0.0, largest], [0.5], sign=sign)
    assert_close(heaving, up)


@pytest.mark.parametrize(
    ("key", "nonlinear", "law"),
    [
        ("passive_stiffness/linear", [], lambda q, v: [q, np.ones_like(q)]),
        ("passive_stiffness/cubic", [], lambda q, v: [q**3]),
        (
            "passive_stiffness/exponential",
            [0.3],
            lambda q, v: [np.exp(q / 0.3) - 1, 1 - np.exp(-q / 0.3), np.ones_like(q)],
        ),
        ("coulomb_friction/coulomb", [0.1], lambda q, v: [np.tanh(v / 0.1)]),
        ("drag/quadratic", [], lambda q, v: [v * np.abs(v)]),
    ],
)
def test_moments_of_the_joint(key, nonlinear, law):
    columns = FORMS[key].columns(MOTION, np.array(nonlinear))
    expected = law(angle(TIME), rate(angle, TIME))
    for moment, law_moment in zip(columns, expected, strict=True):
        assert_close(moment, law_moment)


def test_channels_follow_the_motion():
    late = MOTION.delayed(0.05)
    assert np.allclose(late.channels["length"][100:], stretched(TIME[100:] - 0.05), atol=1e-4)
    assert late.channels["length"][0] == stretched(0.0)
    assert MOTION.replace_position(TIME).channels is CHANNELS
    assert MOTION.through(lambda motion: motion.position).channels is CHANNELS
    assert len(MOTION.beginning(300).channels["box_held"]) == len(MOTION.beginning(300)) == 300


def residual_of(added):
    """Return the residual of an added moment after a fit of the base."""
    columns = np.stack(BASES["pendulum"].form.columns(MOTION, np.zeros(0)), axis=1)
    return added - columns @ np.linalg.lstsq(columns, added, rcond=None)[0]


@pytest.mark.parametrize(("grasp", "release"), [(3.0, 9.5), (0.0, 12.0), (7.2, 20.0)])
def test_interval_of_load_is_found(grasp, release):
    carriers = [MOTION.acceleration, np.sin(MOTION.position)]
    added = (grasp < TIME) * (release > TIME) * (3 * carriers[0] + 60 * carriers[1])
    (interval,) = interval_starts(MOTION, residual_of(added), carriers)
    assert interval == pytest.approx([max(grasp, 0.01), release], abs=0.13)
