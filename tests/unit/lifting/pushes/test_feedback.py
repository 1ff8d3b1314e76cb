"""A person's own feedback: gains that trials were simulated with are found again."""

import numpy as np
import pytest
from lifting_cases import minimum_jerk, pendulums_of

from lumbar.base.errors import InputError
from lumbar.lifting.pushes.feedback import estimate_feedback

POINTS = 201


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
