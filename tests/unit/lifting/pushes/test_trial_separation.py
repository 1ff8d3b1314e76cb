"""Repeated trials: measures of a made body by hand, exact p; gains that trials were simulated with are found again."""

import numpy as np
import pytest
from lifting_cases import minimum_jerk, pendulums_of, perturbation_settings
from scipy.stats import mannwhitneyu

from lumbar.base.errors import InputError
from lumbar.lifting.pushes.trial_separation import (
    BodyTrial,
    estimate_feedback,
    measures_of_trial,
    separation_frame,
    separation_table,
)

SETTINGS = perturbation_settings()
POINTS = 201


def test_a_body_that_drifts_forward_has_the_margins_of_the_formula():
    time = np.arange(101) / 100
    centre = np.stack([0.02 + 0.05 * time, np.full(101, 0.93)], axis=1)
    trunk = np.broadcast_to([0.1, 0.3], (101, 2))
    found = measures_of_trial(
        BodyTrial("t", "perturbed", 100.0, centre, trunk, -0.07, 0.18, 0.07, 1.0), SETTINGS
    )
    # Pendulum of the ankles' height and the centre's above them; functional base: 60 % of the way from its middle.
    at_end = 0.07 + 0.05 * np.sqrt(np.hypot(0.07, 1.0) / 9.81)
    assert found["margin_forward"] == pytest.approx(0.055 + 0.6 * 0.125 - at_end, abs=1e-9)
    assert found["margin_backward"] == pytest.approx(
        0.02 + 0.05 * np.sqrt(np.hypot(0.02, 1.0) / 9.81) - (0.055 - 0.6 * 0.125), abs=1e-9
    )
    assert found["trunk_inclination"] == pytest.approx(np.degrees(np.arctan2(0.1, 0.3)))
    assert found["hip_moment"] == pytest.approx(0.678 * 70 * 9.81 * 0.1, rel=1e-9)


def test_groups_are_compared_exactly_and_corrected():
    rng = np.random.default_rng(2)
    groups = ["unperturbed"] * 5 + ["perturbed"] * 5
    found = [
        {"basin": float(rng.random() + 3 * (group == "perturbed")), "duration": float(rng.random())}
        for group in groups
    ]
    frame = separation_frame(found, groups).set_index("measure")
    assert frame.loc["basin", "auc"] == 1.0
    assert frame.loc["basin", "p_exact"] == pytest.approx(2 / 252)
    assert frame.loc["basin", "p_holm"] == pytest.approx(4 / 252)
    first, second = (
        [item["duration"] for item, group in zip(found, groups, strict=True) if group == name]
        for name in ("perturbed", "unperturbed")
    )
    test = mannwhitneyu(first, second, method="exact")
    assert frame.loc["duration", ["auc", "p_exact", "p_holm"]].tolist() == pytest.approx(
        [test.statistic / 25, test.pvalue, test.pvalue]
    )
    notes = separation_table(frame.reset_index(), groups, "test").notes
    assert notes[0] == "basin separates all trials (5 unperturbed, 5 perturbed, one person)"


@pytest.fixture(scope="module")
def pendulum():
    return pendulums_of([minimum_jerk(mass=60.0, length=0.9)], "inverted", knots=(POINTS + 1) // 2)


def known_gains():
    phase = np.linspace(0, 1, POINTS)
    return np.stack([900 - 200 * phase, 150 + 60 * phase], axis=1)


def trials_of(pendulum, rng, sets, count, noise=25.0):
    """Trials under the known gains and a white torque that holds for one step; arrays (sets, count, points)."""
    step = pendulum.duration[0] / (POINTS - 1)
    mean, gains = pendulum.angle[:, 0], known_gains()
    e, w = rng.normal(0, 0.03, (sets, count)), rng.normal(0, 0.1, (sets, count))
    seen = []
    for point in range(POINTS):
        gravity = pendulum.gravity_torque[0] * (np.sin(mean[point] + e) - np.sin(mean[point]))
        torque = -gains[point, 0] * e - gains[point, 1] * w + rng.normal(0, noise, e.shape)
        a = (torque - pendulum.damping[0] * w - gravity) / pendulum.inertia[0]
        seen.append((e, w, a))
        e, w = e + step * w, w + step * a
    return np.moveaxis(np.array(seen), 0, -1)


def test_intervals_of_gains_cover_what_trials_were_made_with(pendulum):
    """Of 300 sets of 8 trials, 92 to 98 % hold K1 and K2 at the start, middle and end."""
    sets = trials_of(pendulum, np.random.default_rng(5), 300, 8)
    true, held = known_gains(), []
    for e, w, a in zip(*sets, strict=True):
        low, high = estimate_feedback(pendulum, e, w, a)
        held.append(((low <= true) & (true <= high))[[0, POINTS // 2, -1]])
    assert (np.mean(held, axis=0) >= 0.92).all() and (np.mean(held, axis=0) <= 0.98).all()


def test_three_trials_are_refused(pendulum):
    few = np.zeros((3, POINTS))
    with pytest.raises(InputError, match="3 trials; at least 4"):
        estimate_feedback(pendulum, few, few, few)
