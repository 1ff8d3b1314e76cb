"""Largest stable gains of random loops against eigenvalues of a state-space model that is written here anew."""

import numpy as np
import pytest
from scipy.linalg import expm

from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.passivity import required_damping
from study_settings import changed


def drawn_loop(rng):
    """A stable model of order 1 to 3, of either sign of static stiffness or without any, late, in a stiff, soft or no hand."""
    order = rng.integers(1, 4)
    poles = rng.uniform(-0.2, 0.98, order).astype(complex)
    if order > 1 and rng.random() < 0.4:
        poles[0] = rng.uniform(0.3, 0.97) * np.exp(1j * rng.uniform(0.05, 2.5))
        poles[1] = poles[0].conj()
    denominator, numerator = np.poly(poles).real, 2000 * rng.standard_normal(order + 1)
    if rng.random() < 0.1:
        numerator[-1] -= numerator.sum()
    numerator = np.r_[np.zeros(rng.integers(0, 4)), numerator]
    period = rng.choice([1e-3, 2e-3, 1e-2])
    delay = rng.choice([0.0, rng.uniform(0.05, 0.95) * period])
    device = {"mass_kg": rng.uniform(0.05, 1.0), "damping_N_s_m": 10 ** rng.uniform(-1, 1)}
    hand = rng.choice([0.0, 0.0, 50.0, 300.0, 1500.0])
    return SampledModel("drawn", numerator, denominator, float(period), float(delay)), device, float(hand)


def transition(model, mass, damping, hand, gain):
    """Over one sample: position, velocity, force, and the model's states in controller form."""
    order = max(len(model.numerator), len(model.denominator)) - 1
    b, a = (np.pad(part, (0, order + 1 - len(part))) for part in (model.numerator, model.denominator))
    moving = np.array([[0.0, 1.0, 0.0], [-hand / mass, -damping / mass, 1.0 / mass], [0.0, 0.0, 0.0]])
    newest = np.zeros(3 + order)
    newest[0], newest[3:] = 1.0, -a[1:]
    force = b[0] * newest
    force[3:] += b[1:]
    at_new = expm(moving * model.delay) @ np.eye(3 + order)[:3]
    at_new[2] = -gain * force
    whole = np.zeros((3 + order, 3 + order))
    whole[:3] = expm(moving * (model.sampling_time - model.delay)) @ at_new
    whole[3], whole[4:, 3:-1] = newest, np.eye(order - 1)
    return whole


def gain_by_eigenvalues(model, device, hand):
    """By bisection between a factor that is stable with all below it and the first on a fine grid that is not."""
    drifts = hand == 0 and abs(model.numerator.sum()) < 1e-9 * np.abs(model.numerator).sum()

    def unstable(gain):
        poles = np.linalg.eigvals(transition(model, *device.values(), hand, gain))
        if drifts:  # a stylus that nobody holds stays where it is left
            poles = np.delete(poles, np.abs(poles - 1.0).argmin())
        return np.abs(poles).max() >= 1 + 1e-12

    stable = 0.0
    for tried in np.geomspace(1e-6, 1e6, 600):
        if unstable(tried):
            break
        stable = tried
    else:
        return np.inf
    for _ in range(60 if stable else 0):
        middle = (stable + tried) / 2
        stable, tried = (stable, middle) if unstable(middle) else (middle, tried)
    return stable


def disagreement(rng):
    """What is wrong about one drawn loop; empty where nothing is."""
    model, values, hand = drawn_loop(rng)
    device = changed(RuntimeSettings(), device=values | {"hand_stiffness_N_m": hand}).device
    found, expected = largest_stable_gain(model, device)[0], gain_by_eigenvalues(model, values, hand)
    stiffness = model.numerator.sum() / model.denominator.sum()
    if stiffness < -1e-6 and np.isfinite(required_damping(model, 200)):
        return f"passive with {stiffness:g} N/m"
    if found == pytest.approx(expected, rel=1e-5, abs=1e-6) or (found > 1e6 and np.isinf(expected)):
        return ""
    return f"{model}, {values}, {hand} N/m: {found}, by eigenvalues {expected}"


def test_gains_are_those_of_the_eigenvalues():
    rng = np.random.default_rng(1)
    assert [text for _ in range(100) if (text := disagreement(rng))] == []


@pytest.mark.statistical
def test_two_thousand_loops_have_no_false_stable():
    rng = np.random.default_rng(2)
    assert [text for _ in range(2000) if (text := disagreement(rng))] == []
