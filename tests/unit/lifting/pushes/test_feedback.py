"""A person's own feedback: what trials were simulated with is found again, and what they cannot tell is said."""

import re
from dataclasses import replace

import numpy as np
import pytest
from lifting_cases import minimum_jerk, pendulums_of, perturbation_settings
from scipy.linalg import expm

from lumbar.base.errors import InputError, NumericalError
from lumbar.lifting.pushes.feedback import (
    FURTHEST_DEG,
    basin_area,
    feedback_sentence,
    identify_feedback,
    interval_of,
)
from lumbar.lifting.stability.comparison.perturbed_trials import PHASE_POINTS, Trial
from lumbar.settings.stability import StabilitySettings

POINTS, FINE = 201, 10
GAINS, DELAY = np.array([900.0, 230.0]), 0.1


@pytest.fixture(scope="module")
def pendulum():
    return pendulums_of(
        [minimum_jerk(duration=2.0, mass=0.678 * 70, length=0.9)], "inverted", knots=(POINTS + 1) // 2
    )


def trials_of(pendulum, seed, count=16, push=120.0, acts=lambda e, w, time: 1.0, unpushed=4):
    """Angles and torques of trials of a delayed person with a torque of one's own, by small steps of Euler."""
    rng, step = np.random.default_rng(seed), 0.01 / FINE
    time = step * np.arange(FINE * (POINTS - 1) + 1)
    size = push * rng.uniform(0.5, 1.5, count) * np.where(np.arange(count) % 2, 1, -1)
    size[:unpushed] = 0.0
    onset = rng.uniform(0.1, 1.1, (count, 1))
    torque = size[:, None] * ((time >= onset) & (time < onset + 0.15))
    mean = np.interp(time, time[::FINE], pendulum.angle[:, 0])
    noise, lag = 6 * rng.standard_normal(count), round(DELAY / step)
    states = [rng.normal(0, [[0.01], [0.05]], (2, count))]
    for point in range(len(time) - 1):
        e, w = states[-1]
        felt = states[point - lag] if point >= lag else np.zeros((2, count))
        noise = noise - 0.005 * noise + 0.6 * rng.standard_normal(count)
        own = acts(*felt, time[point]) * (GAINS @ felt)
        gravity = pendulum.gravity_torque * (np.sin(mean[point] + e) - np.sin(mean[point]))
        a = (torque[:, point] + noise - own - pendulum.damping * w - gravity) / pendulum.inertia
        states.append(np.stack([e + step * w, w + step * a]))
    angle = mean[::FINE] + np.stack(states[::FINE])[:, 0].T
    return angle + rng.normal(0, 1e-3, angle.shape), torque[:, ::FINE]


def test_gains_and_delay_lie_in_their_intervals(pendulum):
    """Of 40 persons 34 at least hold each (by chance fewer in 3 of 1000 where 95 % do), and most can be told."""
    held, told = [], 0
    for seed in range(40):
        found = identify_feedback(pendulum, *trials_of(pendulum, seed))
        estimates = [*found.gains[:, POINTS // 2].T, found.delay]
        ends = [interval_of(values) for values in estimates]
        held.append([low <= true <= high for (low, high), true in zip(ends, [*GAINS, DELAY], strict=True)])
        told += not found.unknown
    assert (np.sum(held, axis=0) >= 34).all() and told >= 34


def test_the_basin_of_a_linear_loop_is_that_of_its_matrix(pendulum):
    """Without gravity the furthest start of a direction follows from powers of exp(A·step)."""
    free = replace(pendulum, gravity_torque=np.zeros(1))
    found = basin_area(free, np.broadcast_to(GAINS, (1, POINTS, 2)), np.zeros(1), StabilitySettings())
    turn = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    start = np.stack([np.cos(turn), 4 * np.sin(turn)])
    matrix = np.array([[0, 1], [-GAINS[0], -GAINS[1] - 1]] / np.array([[1], [pendulum.inertia[0]]]))
    step, states = expm(0.01 * matrix), [start]
    for _ in range(POINTS - 1):
        states.append(step @ states[-1])
    furthest = np.radians(FURTHEST_DEG) / np.abs(np.array(states)[:, 0]).max(axis=0)
    goal = 1 / np.sqrt(np.array([100, 10]) @ states[-1] ** 2)
    assert found[0] == pytest.approx(4 * np.pi * np.mean(np.minimum(furthest, goal) ** 2), rel=0.02)


def test_what_trials_cannot_tell_is_said_with_the_experiment_that_would(pendulum):
    angle, push = trials_of(pendulum, 1)
    with pytest.raises(InputError, match="7 trials; at least 8 are needed"):
        identify_feedback(pendulum, angle[:7], push[:7])
    with pytest.raises(InputError, match="differs from the others' in 0 trials, at least 3"):
        identify_feedback(pendulum, angle, np.tile(push[5], (16, 1)))
    with pytest.raises(NumericalError, match="one clock"):
        identify_feedback(pendulum, angle, np.roll(push, 60, axis=1))
    small = identify_feedback(pendulum, *trials_of(pendulum, 4, push=20.0))
    assert any("such trials would do, or pushes" in reason for reason in small.unknown)
    for acts in (
        lambda e, w, time: np.where(np.abs(e) > 0.06, 1.5, 0.8),
        lambda e, w, time: 2 * (time % 0.3 < 0.15),
        lambda e, w, time: e**2 + (w / 3) ** 2 > 0.05**2,
    ):
        other = identify_feedback(pendulum, *trials_of(pendulum, 3, count=24, acts=acts))
        assert any("50 ms apart" in reason for reason in other.unknown)


def test_a_study_says_the_feedback_and_its_basin_or_why_not(pendulum):
    angle, push = trials_of(pendulum, 1)
    phase, time = np.linspace(0, 1, PHASE_POINTS), np.linspace(0, 1, POINTS)
    trials = [Trial("t", "perturbed", 2.0, np.interp(phase, time, one), phase, 0.9) for one in angle]
    torques = [None] * 4 + [(2 * time, torque) for torque in push[4:]]
    settings = perturbation_settings(pushes={"files": ["d"], "arm_m": 1.0})

    def said(settings, trials):
        return feedback_sentence(trials, torques[: len(trials)], settings, StabilitySettings())

    low, high, *_ = map(float, re.findall(r"K1 (\d+) to (\d+)", said(settings, trials))[0])
    assert low < GAINS[0] < high < 1.5 * low
    assert "brings the person back" in said(settings, trials) and "rad²/s, with the study's" in said(
        settings, trials
    )
    assert "cannot be told" in said(settings, trials[:7]) and "7 trials" in said(settings, trials[:7])
    assert "without recorded forces" in said(perturbation_settings(), trials)
    with pytest.raises(ValueError, match="2 files for 1 perturbed trials"):
        perturbation_settings(pushes={"files": ["d", "e"], "arm_m": 1.0})
