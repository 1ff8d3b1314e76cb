"""States that follow differential equations, against an independent solver, closed forms and the C code."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.expression import expand_sums, parse
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.state_equation import (
    StateEquation,
)

STEP = 0.01
SOLVED = {form.key: form for effect in TISSUE.values() for form in effect.forms if form.solution is not None}


def walk(seed: int, samples: int = 400) -> np.ndarray:
    """Positions with reversals and rests."""
    generator = np.random.default_rng(seed)
    steps = generator.standard_normal(samples) * 0.1
    steps[generator.random(samples) < 0.1] = 0.0
    return np.cumsum(steps) - steps[0]


def straight(positions: np.ndarray, sampling_time: float = STEP) -> Motion:
    """Motion in straight lines between samples."""
    return Motion(np.arange(len(positions)) * sampling_time, positions, sampling_time, smooth=False)


def equations(**slopes: str) -> StateEquation:
    return StateEquation({name: expand_sums(parse(text)) for name, text in slopes.items()})


def solved(state: StateEquation, motion: Motion, slope, values: dict) -> np.ndarray:
    """States by Runge and Kutta between samples, where nothing has a kink; shape (states, samples)."""
    found = [np.zeros(len(state.names))]
    for k in range(len(motion) - 1):
        velocity = motion.increments[k + 1] / motion.sampling_time

        def rate(time, r, k=k, velocity=velocity):
            position = motion.position[k] + velocity * time
            path = motion.path[k] + abs(velocity) * time
            return slope(r, position, velocity, motion.time[k] + time, path, **values)

        found.append(
            solve_ivp(rate, (0, motion.sampling_time), found[-1], "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        )
    return np.array(found).T


CASES = {
    "maxwell": ({"q": "v - q/tau"}, lambda r, z, v, t, s, tau: [v - r[0] / tau], {"tau": 0.03}),
    "dahl": (
        {"r": "v/d*(1 - r*sign(v))"},
        lambda r, z, v, t, s, d: [v / d * (1 - r[0] * np.sign(v))],
        {"d": 0.2},
    ),
    "zener in positions": ({"q": "(k*z - q)/tau"}, lambda r, z, v, t, s, k, tau: [(k * z - r[0]) / tau], {"k": 2.0, "tau": 0.05}),
    "two branches, coupled": (
        {"p": "v - p/tau + q/T", "q": "p/T - q/tau + t - s"},
        lambda r, z, v, t, s, tau, T: [v - r[0] / tau + r[1] / T, r[0] / T - r[1] / tau + t - s],
        {"tau": 0.05, "T": 0.3},
    ),
    "an oscillator": (
        {"x": "y", "y": "w**2*(z - x) - 2*w*c*y"},
        lambda r, z, v, t, s, w, c: [r[1], w**2 * (z - r[0]) - 2 * w * c * r[1]],
        {"w": 40.0, "c": 0.2},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_linear_equations_are_solved_exactly(case):
    texts, slope, values = CASES[case]
    state, motion = equations(**texts), straight(walk(1))
    found = state.trajectory(motion, values)
    expected = solved(state, motion, slope, values)
    for name, wanted in zip(state.names, expected, strict=True):
        assert np.abs(found[name] - wanted).max() < 1e-9 * np.abs(expected).max()


NONLINEAR = {
    "stiffening branch": (
        {"q": "v - q/tau*(1 + (q/q_1)**2)"},
        lambda r, z, v, t, s, tau, q_1: [v - r[0] / tau * (1 + (r[0] / q_1) ** 2)],
        {"tau": 0.05, "q_1": 0.2},
    ),
    "two states": (
        {"p": "v - sinh(p/c)/tau", "q": "(p*p - q)/tau + z"},
        lambda r, z, v, t, s, tau, c: [v - np.sinh(r[0] / c) / tau, (r[0] * r[0] - r[1]) / tau + z],
        {"tau": 0.05, "c": 0.3},
    ),
}


@pytest.mark.parametrize("case", NONLINEAR)
def test_other_equations_are_solved_to_the_second_order(case):
    """Every halving of the step divides the error by four."""
    texts, slope, values = NONLINEAR[case]
    state = equations(**texts)
    coarse = straight(walk(2, 200))
    expected = solved(state, coarse, slope, values)
    errors = []
    for parts in (4, 8, 16):
        time = np.arange((len(coarse) - 1) * parts + 1) / parts
        fine = straight(np.interp(time, np.arange(len(coarse)), coarse.position), STEP / parts)
        found = np.array(list(state.trajectory(fine, values).values()))[:, ::parts]
        errors.append(np.abs(found - expected).max() / np.abs(expected).max())
    assert errors[0] < 0.02
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.6)
    assert errors[1] / errors[2] == pytest.approx(4, abs=0.4)


def test_an_iteration_that_does_not_end_falls_back_to_steps():
    """A state that jumps between two branches: Newton's linearisation sees no slope."""
    state, motion = equations(r="v*c*where(r > 0, -1, 1) + where(r > 0.1, -c, 0)"), straight(walk(4))
    known = {"c": 300.0, **state._between(motion)}
    found = state.trajectory(motion, {"c": 300.0})["r"]
    np.testing.assert_array_equal(found, state.in_steps(known, len(motion) - 1)[0])


@pytest.mark.parametrize(
    ("key", "numbers"),
    [
        *((key, (0.15, 0.7)) for key in SOLVED),
        *(("hysteresis/bouc_wen_general", (0.15, w)) for w in (0.01, 0.5, 1.0, 1.1875)),
        ("hysteresis/bouc_wen_general", (1.5, 2.5)),
    ],
)
def test_closed_forms_are_what_their_equations_say(key, numbers):
    """For the same straight lines: exact where the equation is linear, else to the step's second order."""
    form, motion = SOLVED[key], straight(walk(5))
    nonlinear = np.array(numbers)[: len(form.nonlinear)]
    values = {item.symbol: value for item, value in zip(form.nonlinear, nonlinear, strict=True)}
    closed = np.array(form.solution(motion, nonlinear))
    state = form._equation.state
    found = np.array(list(state.trajectory(motion, values).values()))
    if state.is_linear:
        assert np.abs(found - closed).max() < 1e-12 * np.abs(closed).max()
        return
    errors = [np.abs(found - closed).max()]
    for parts in (10, 100):
        time = np.arange((len(motion) - 1) * parts + 1) / parts
        fine = straight(np.interp(time, np.arange(len(motion)), motion.position), STEP / parts)
        found = np.array(list(state.trajectory(fine, values).values()))
        errors.append(np.abs(found[:, ::parts] - closed).max())
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.02 * errors[1]


def test_equations_apart_are_solved_apart_and_alike():
    state = equations(q="v - q/tau", r="(s - q*r)/tau", u="(z - u)/tau", p="v - p*abs(p)/tau")
    assert [part.names for part in state.apart] == [("q", "r"), ("u",), ("p",)]
    motion, values = straight(walk(3)), {"tau": 0.3}
    found = state.trajectory(motion, values)
    together = state.in_steps({**values, **state._between(motion)}, len(motion) - 1)
    assert list(found) == list(state.names)
    for path, reference in zip(found.values(), together, strict=True):
        assert path == pytest.approx(reference, abs=1e-9 * np.abs(reference).max())


def test_a_state_that_snaps_between_two_places_against_an_ode_solver():
    """Between its places of rest it runs away from any guess by e^4 in ten samples: no iteration over the record ends."""
    time = np.arange(1200) * STEP / 10
    position = 4 * np.sin(2 * np.pi * 1.3 * time) + 1.5 * np.cos(2 * np.pi * 3.1 * time + 0.4)
    motion = straight(position - position[0], STEP / 10)
    state = equations(u="(z + u*(1 - (u/w)**2))/tau")
    values = {"w": 1.5, "tau": 0.025}

    def slope(u, position, velocity, time, path, w, tau):
        return (position + u * (1 - (u / w) ** 2)) / tau

    found = state.trajectory(motion, values)["u"]
    truth = solved(state, motion, slope, values)[0]
    assert np.ptp(np.sign(truth)) == 2
    assert np.abs(found - truth).max() < 2e-3 * np.abs(truth).max()


def test_a_state_without_bounds_ends_as_no_number_and_not_as_an_error():
    found = equations(r="exp(r)*(1 + abs(z)) + sin(r)").trajectory(straight(walk(5)), {})["r"]
    assert np.isfinite(found[:5]).all() and not np.isfinite(found[-1])
