"""A person's own feedback, gains and delay, from repeated trials with recorded pushes; and the basin with it.

With the pendulum of Eq. 4.1 and the torque p of a push about its pivot, deviations e and ω from the mean movement obey

    I·θ̈ + b·ω + σmgℓ·sin θ − p = c(t) − K1(t)·e(t − τ) − K2(t)·ω(t − τ) + d.

c is the same in all trials and goes with their mean at equal time. The person's own noise d goes round the loop, and a
regression on the states takes it for feedback (van der Kooij et al., J. Neurosci. Methods 145 (2005) 175–203). Pushes know
nothing of it. So the instruments are the states with which the loop of an early estimate answers the pushes (Young and
Jakeman, Int. J. Control 29 (1979) 1–30): four for K1 and K2, linear in time, one for the delay. Noise of the angles does not
bias them either. Intervals leave out one trial after the other.

A feedback that does not always act alike (Gawthrop et al., Biol. Cybern. 104 (2011) 31–51) leaves its own torque times a function
of time. Such products, orthogonal to the estimates (Neyman's C(α)), are compared with those of other trials' pushes. One that
acts above a threshold alone leaves its torque below it. Where pushes have been answered, what a linear loop leaves goes with its
states as a line, since both are the noise's.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.population.contrast import jackknife_interval
from lumbar.lifting.stability.comparison.perturbed_trials import PHASE_POINTS, Trial, mean_trajectory
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, gather, remainder
from lumbar.lifting.stability.model.eq_4_2_regulator import regulate, weights_of
from lumbar.settings.pushes import OutcomeSettings, PerturbationsSettings
from lumbar.settings.stability import StabilitySettings

FEWEST_TRIALS, FEWEST_DIFFERENT = 8, 3
_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
NOT_RECORDED = _SAID["not_recorded"].format(fewest=FEWEST_TRIALS)
LONGEST_DELAY_S, LARGEST_SHIFT_S, DELAY_TOLERANCE_S = 0.35, 0.05, 1e-4
"""Of the delay: the most, the most of one step and below 0, and the last step."""
PASSES, SETTLED = 60, 2
"""Most steps towards the estimate, and those after which the instruments stay."""
WIDEST, SIGNIFICANCE = 0.5, 0.02
"""Half-width of an interval as a share of its gain with which the feedback still counts as known; p of no linear feedback."""
FASTEST_HZ, SHUFFLES = 6.0, 999
"""Change of gains that is looked for, and orders of the trials that it is compared with."""
SMOOTHED_S, ANSWERED, USUAL = 0.03, 0.05, 0.95
"""Of the search for a threshold: standard deviation of the window that averages noise, and the size of an error, as a share of
that below which the third share of errors stay, to which a push is answered."""
THRESHOLDS = 0.1, 0.2, 0.4, 0.8
"""That are looked for, as shares of the same."""
RETURNING = 5.0
"""How many times as far as the first a loop may answer the pushes that still makes instruments."""
FURTHEST_DEG = OutcomeSettings().lean_deg
"""From the movement, beyond which nobody returns."""
DIRECTIONS, LARGEST_START, FALLING_1_S = 32, 4.0, 5.0
"""In which starts are looked for, and how far: in `FURTHEST_DEG`, velocities in that times about the rate of a fall."""
EDGE = 2
"""Points at either end that second differences spoil."""


@dataclass(frozen=True)
class Feedback:
    """Estimates from all trials, followed by those without each; first axis 1 + trials."""

    gains: np.ndarray
    """Shape (1 + trials, points, 2): K1(t) in N·m/rad and K2(t) in N·m·s/rad."""
    delay: np.ndarray
    """Shape (1 + trials,): τ in s; noise may put a short one below 0."""
    p_linear: float
    """How often a feedback linear in states and time that always acts leaves as much that hangs on pushes or sizes."""
    unknown: tuple[str, ...]
    """Why the trials cannot tell the feedback, and which experiment would; empty where they can."""


def follow_errors(
    pendulum: Pendulums, gains: np.ndarray, delay: np.ndarray, push: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Follow errors through loops with delay and the true sine, by Heun's method; before t = 0 there is no error.

    One pendulum has many loops: `gains` of shape (loops, points, 2), `delay` (loops,), `push` (loops or 1, points) in N·m and
    `start` (2, loops). Returned is the error of angle and velocity, shape (2, loops, points).
    """
    points, loops = len(pendulum.angle), np.arange(start.shape[1])
    a21, a22, b2 = pendulum.linearisation(pendulum.angle)
    curved = pendulum.gravity_torque / pendulum.inertia
    step = float(pendulum.duration[0]) / (points - 1)
    whole, part = np.divmod(np.maximum(delay, 0.0) / step, 1.0)
    whole = whole.astype(int)
    # The error before t = 0, all zero, stands first.
    before = int(whole.max()) + 1
    state = np.zeros((before + points, 2, len(loops)))
    state[before] = start

    def rate(point: int) -> np.ndarray:
        late, (e, w) = before + point - whole, state[before + point]
        felt = (1 - part) * state[late, :, loops].T + part * state[late - 1, :, loops].T
        torque = push[:, point] - (gains[:, point].T * felt).sum(axis=0)
        gravity = a21[point] * e - curved * remainder(pendulum.angle[point], e)
        return np.stack([w, gravity + a22 * w + b2 * torque])

    for point in range(points - 1):
        first, here = rate(point), state[before + point]
        state[before + point + 1] = here + step * first
        state[before + point + 1] = here + 0.5 * step * (first + rate(point + 1))
    return np.moveaxis(state[before:], 0, -1)


def delayed(values: np.ndarray, lag: float) -> np.ndarray:
    """Return values at `lag` points earlier, linear between points, 0 before the first; time is the last axis."""
    last = values.shape[-1] - 1
    place = np.minimum(np.arange(last + 1) - lag, last)
    low = np.clip(place.astype(int), 0, last - 1)
    return (values[..., low] + (place - low) * (values[..., low + 1] - values[..., low])) * (place >= 0)


@dataclass(frozen=True)
class _Trials:
    """Deviations of trials from their mean at equal time, shape (trials, points) each."""

    pendulum: Pendulums
    states: np.ndarray
    """Shape (2, trials, points): rad and rad/s."""
    torque: np.ndarray
    """Of the feedback and the person's noise, N·m."""
    push: np.ndarray
    step: float
    """Seconds between points."""
    basis: np.ndarray
    """Constant and linear in time, shape (points, 2)."""

    def gains(self, found: np.ndarray) -> np.ndarray:
        """Return K1(t) and K2(t), shape (..., points, 2), of coefficients whose first four are theirs."""
        return np.einsum("pi,...ki->...pk", self.basis, found[..., :4].reshape(*found.shape[:-1], 2, 2))

    def columns(self, states: np.ndarray, delay: float) -> np.ndarray:
        """Return delayed states times the basis, shape (trials, points, 4)."""
        late = delayed(states, delay / self.step)
        return np.concatenate([item[..., None] * self.basis for item in late], axis=-1)

    def answer(self, gains: np.ndarray, delay: float) -> np.ndarray:
        """Return angle, velocity and acceleration with which a loop answers the pushes, shape (3, trials, points)."""
        count = len(self.push)
        each = np.broadcast_to(gains, (count, *gains.shape))
        e, w = follow_errors(self.pendulum, each, np.full(count, delay), self.push, np.zeros((2, count)))
        answer = np.stack([e, w, np.gradient(w, self.step, axis=1)])
        return answer - answer.mean(axis=1, keepdims=True)

    def instruments(self, answer: np.ndarray, gains: np.ndarray, delay: float) -> np.ndarray:
        """Return four instruments for the gains and the torque's slope over the delay, shape (trials, points, 5)."""
        _, w, a = delayed(answer, delay / self.step)
        slope = -(gains[:, 0] * w + gains[:, 1] * a)[..., None]
        return np.concatenate([self.columns(answer[:2], delay), slope], axis=-1)


def identify_feedback(pendulum: Pendulums, angle: np.ndarray, push: np.ndarray) -> Feedback:
    """Estimate K1(t), K2(t) and their delay.

    Parameters
    ----------
    pendulum : Pendulums
        One, about the mean movement.
    angle : numpy.ndarray, shape (trials, points)
        θ in rad at the even times of the pendulum, from an event before the push.
    push : numpy.ndarray, shape (trials, points)
        Torque of the push about the pivot in N·m, positive as the angle and filtered as it; zero in trials without.

    Raises
    ------
    InputError
        Fewer than `FEWEST_TRIALS` trials, or no pushes that differ between trials.
    NumericalError
        No delay up to `LONGEST_DELAY_S` explains the answers.
    """
    trials = _trials(pendulum, angle, push)
    # The first guess: twice what gravity asks, well damped, a tenth of a second late.
    stiffness = 2 * np.abs(pendulum.gravity_torque[0])
    gains = np.tile([stiffness, np.sqrt(2 * pendulum.inertia[0] * stiffness)], (angle.shape[1], 1))
    delay = 0.1
    answer = trials.answer(gains, delay)
    reach, instruments = np.abs(answer[0]).max(), np.empty(0)
    for count in range(PASSES):
        # A loop that does not return answers nothing of use: the last one that did stays.
        again = trials.answer(gains, delay)
        answer = again if np.abs(again[0]).max() < RETURNING * reach else answer
        newest = trials.instruments(answer, gains, delay)
        instruments = newest if count < SETTLED else instruments
        # The slope over the delay is always that of the newest loop: the intervals hang on it.
        regressors = np.concatenate([trials.columns(trials.states, delay), newest[..., 4:]], axis=-1)
        squares, products = map(_sums, _moments(instruments, regressors, trials.torque))
        every = np.linalg.solve(squares, products[..., None])[..., 0]
        gains, shift = trials.gains(every[0]), every[0, 4]
        moved = delay + np.clip(shift, -LARGEST_SHIFT_S, LARGEST_SHIFT_S)
        delay = float(np.clip(moved, -LARGEST_SHIFT_S, LONGEST_DELAY_S))
        if count >= SETTLED and abs(shift) < DELAY_TOLERANCE_S:
            left, own = trials.torque + regressors @ every[0], every[0, :4]
            p_always = _p_always(left, newest[..., :4] @ own, instruments, regressors, trials.step)
            falling = float(np.sqrt(np.abs(pendulum.gravity_torque[0]) / pendulum.inertia[0]))
            p_even = _p_even(left, regressors[..., :4], newest[..., :4], own, falling, trials.step)
            p_linear = min(1.0, 3 * min(p_always, p_even))
            return _feedback(pendulum, trials.gains(every), delay - shift + every[:, 4], p_linear)
    raise NumericalError(_SAID["no_delay"].format(longest=LONGEST_DELAY_S, trials=len(push)))


def _trials(pendulum: Pendulums, angle: np.ndarray, push: np.ndarray) -> _Trials:
    if len(angle) < FEWEST_TRIALS:
        raise InputError(_SAID["few_trials"].format(trials=len(angle), fewest=FEWEST_TRIALS))
    other = np.abs(push - np.median(push, axis=0)).max(axis=1) > 1e-6 * np.abs(push).max()
    if (differ := int(other.sum())) < FEWEST_DIFFERENT:
        raise InputError(_SAID["alike"].format(differ=differ, fewest=FEWEST_DIFFERENT))
    step = float(pendulum.duration[0]) / (angle.shape[1] - 1)
    rate = np.gradient(angle, step, axis=1, edge_order=2)
    acceleration = np.zeros_like(angle)
    acceleration[:, 1:-1] = np.diff(angle, 2, axis=1) / step**2
    moving = pendulum.inertia * acceleration + pendulum.damping * rate
    torque = moving + pendulum.gravity_torque * np.sin(angle) - push
    apart = [values - values.mean(axis=0) for values in (angle, rate, torque, push)]
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, angle.shape[1]), 1)
    return _Trials(pendulum, np.stack(apart[:2]), *apart[2:], step, basis)


def _moments(*columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what every trial adds to the equations: regressors and negative torque on the instruments."""
    instruments, regressors, torque = (item[:, EDGE:-EDGE] for item in columns)
    squares = np.einsum("tpi,tpj->tij", instruments, regressors)
    return squares, -np.einsum("tpi,tp->ti", instruments, torque)


def _sums(parts: np.ndarray) -> np.ndarray:
    """Sum over all trials and, with the mean over the others, without each; shape (1 + trials, ...)."""
    whole = parts.sum(axis=0)
    return np.concatenate([whole[None], whole - len(parts) / (len(parts) - 1) * parts])


def _p_always(
    left: np.ndarray, own: np.ndarray, instruments: np.ndarray, regressors: np.ndarray, step: float
) -> float:
    """Test that torque left, shape (trials, points), tells nothing of the feedback's `own`, by shuffling trials.

    Returned is the least p of two tests.
    """
    clock = step * np.arange(left.shape[1])
    left, own, instruments, regressors = (
        item[:, EDGE:-EDGE] for item in (left, own, instruments, regressors)
    )
    squares = np.einsum("tpi,tpj->ji", instruments, regressors)
    rng, trial = np.random.default_rng(0), np.arange(len(left))
    orders = np.stack([trial, *(rng.permutation(trial) for _ in range(SHUFFLES))])
    most = np.zeros((2, len(orders)))
    for frequency in np.arange(0.0, FASTEST_HZ, 0.25 / clock[-1]):
        product = own * np.exp(2j * np.pi * frequency * clock[EDGE:-EDGE])
        slope = np.einsum("tp,tpj->j", product, regressors)
        product = product - instruments @ np.linalg.solve(squares, slope)
        each = (left @ (product - product.mean(axis=0)).T)[trial, orders]
        # The gains change alike in all trials, or in each in its own way.
        found = np.stack([np.abs(each.sum(axis=1)) ** 2, (np.abs(each) ** 2).sum(axis=1)])
        most = np.maximum(most, found / found.mean(axis=1, keepdims=True))
    return float((most >= most[:, :1] * (1 - 1e-9)).mean(axis=1).min())


def _p_even(
    left: np.ndarray, states: np.ndarray, answer: np.ndarray, own: np.ndarray, falling: float, step: float
) -> float:
    """Test that torque left goes with small errors as with large ones, by the signs of trials.

    `states`, as of `_Trials.columns`, and `answer` to the pushes have shape (trials, points, 4), `own` makes torque of them.
    An error of velocity is as large as one of the angle over which the body falls with it, by the rate `falling` in 1/s.
    """
    from scipy.ndimage import gaussian_filter1d

    left, states, answer = (
        gaussian_filter1d(values, SMOOTHED_S / step, axis=1)[:, EDGE:-EDGE]
        for values in (left, states, answer)
    )
    size, answered = (np.hypot(values[..., 0], values[..., 2] / falling) for values in (states, answer))
    usual = np.quantile(size, USUAL)
    kept = (answered < ANSWERED * usual) & (size > 0)
    small = np.exp(-((size[..., None] / (usual * np.array(THRESHOLDS))) ** 2))
    values = np.concatenate([left[..., None], (states @ own)[..., None] * small], axis=-1)
    line = np.concatenate([states, answer], axis=-1)[kept]
    curved = np.zeros_like(values)
    curved[kept] = values[kept] - line @ np.linalg.lstsq(line, values[kept])[0]
    each = np.einsum("tp,tpk->tk", curved[..., 0], curved[..., 1:])
    signs = np.random.default_rng(0).choice([-1, 1], (SHUFFLES + 1, len(left)))
    signs[0] = 1
    most = np.abs(signs @ (each / np.maximum(np.linalg.norm(each, axis=0), 1e-300))).max(axis=1)
    return float((most >= most[0] * (1 - 1e-9)).mean())


def _feedback(pendulum: Pendulums, gains: np.ndarray, delay: np.ndarray, p_linear: float) -> Feedback:
    """Judge the estimates at half the movement."""
    middle, trials = gains.shape[1] // 2, len(gains) - 1
    first, second = gains[:, middle].T
    unknown = []
    for name, values in (("K1", first), ("K2", second)):
        low, high = interval_of(values)
        share = (high - low) / (2 * abs(values[0]))
        if share > WIDEST:
            times = (share / WIDEST) ** 2
            needed = {"trials": np.ceil(times * trials), "times": np.sqrt(times)}
            unknown.append(_SAID["wide"].format(name=name, share=100 * share, widest=100 * WIDEST, **needed))
    # What is left of stiffness, and of damping to the first order of the delay.
    net = (
        first + pendulum.gravity_torque * np.cos(pendulum.angle[middle]),
        second + pendulum.damping - delay * first,
    )
    if min(interval_of(values)[0] for values in net) <= 0:
        unknown.append(_SAID["not_returning"])
    if p_linear < SIGNIFICANCE:
        unknown.append(_SAID["not_linear"].format(p=p_linear))
    return Feedback(gains, delay, p_linear, tuple(unknown))


def interval_of(values: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of a number of every estimate, shape (1 + trials,)."""
    low, high = jackknife_interval(values[0], values[1:])
    return float(low), float(high)


def basin_area(
    pendulum: Pendulums, gains: np.ndarray, delay: np.ndarray, stability: StabilitySettings
) -> np.ndarray:
    """Return the area in rad²/s of all starts at t = 0 from which loops with delay return, shape (loops,).

    They do when they end in the goal set and never stray further than `FURTHEST_DEG` from the movement, with the true sine and
    nothing wrong before t = 0. Other than a funnel this needs no V, and holds with a delay. The edge is found in `DIRECTIONS`
    directions, to a thousandth of its furthest place.
    """
    goal, furthest = weights_of(stability).terminal, np.radians(FURTHEST_DEG)
    turn = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    scale = furthest * np.array([1.0, FALLING_1_S])
    direction = np.tile(scale[:, None] * np.stack([np.cos(turn), np.sin(turn)]), len(gains))
    every = [np.repeat(part, DIRECTIONS, axis=0) for part in (gains, delay)]
    quiet = np.zeros((1, gains.shape[1]))

    def returns(radius: np.ndarray) -> np.ndarray:
        # Loops that do not return may overflow.
        with np.errstate(over="ignore", invalid="ignore"):
            e, w = follow_errors(pendulum, *every, quiet, radius * direction)
            near = (np.abs(e) < furthest).all(axis=1)
            last, speed = e[:, -1], w[:, -1]
            value = goal[0] * last**2 + 2 * goal[1] * last * speed + goal[2] * speed**2
            return near & (value <= stability.goal_level)

    radius, step = np.zeros(direction.shape[1]), LARGEST_START / 2
    while step > LARGEST_START / 1000:
        radius = np.where(returns(radius + step), radius + step, radius)
        step /= 2
    return scale.prod() * np.pi * np.mean(radius.reshape(-1, DIRECTIONS) ** 2, axis=1)


def trials_at_equal_time(
    trials: list[Trial],
    torques: list[tuple[np.ndarray, np.ndarray] | None],
    settings: PerturbationsSettings,
    stability: StabilitySettings,
) -> tuple[Pendulums, np.ndarray, np.ndarray]:
    """Return what `identify_feedback` takes: trials from their start to the end of the shortest, standing upright.

    `torques` has of each trial the times in s since its start and the torque in N·m, None without a push.
    """
    from scipy.interpolate import CubicSpline

    duration = min(trial.duration for trial in trials)
    time, phase = np.linspace(0.0, duration, PHASE_POINTS), np.linspace(0.0, 1.0, PHASE_POINTS)
    cut = [
        replace(trial, duration=duration, angle=CubicSpline(phase * trial.duration, trial.angle)(time))
        for trial in trials
    ]
    knots, given = (PHASE_POINTS + 1) // 2, stability.pendulum
    mean = mean_trajectory(cut, settings)
    pendulum = gather([mean], "inverted", given.damping_N_m_s, given.gravity_m_s2, knots)
    push = [np.zeros(PHASE_POINTS) if one is None else np.interp(time, *one, 0.0, 0.0) for one in torques]
    return pendulum, np.array([trial.angle for trial in cut]), np.array(push)


def feedback_sentence(
    trials: list[Trial],
    torques: list[tuple[np.ndarray, np.ndarray] | None],
    settings: PerturbationsSettings,
    stability: StabilitySettings,
) -> str:
    """Say what the trials of a person tell of the feedback, or why they do not, and what the basin is with it.

    Arguments are those of `trials_at_equal_time`.
    """
    if settings.pushes is None:
        return NOT_RECORDED
    try:
        pendulum, angle, push = trials_at_equal_time(trials, torques, settings, stability)
        found = identify_feedback(pendulum, angle, push)
    except (InputError, NumericalError) as error:
        return _SAID["cannot"].format(error=error)
    first, second = (interval_of(values) for values in found.gains[:, PHASE_POINTS // 2].T)
    delay = [1000 * max(end, 0.0) for end in interval_of(found.delay)]
    words = _SAID["found"].format(trials=len(trials), first=first, second=second, delay=delay)
    if found.unknown:
        return _SAID["not_told"].format(found=words, unknown="; ".join(found.unknown))
    low, high = interval_of(basin_area(pendulum, found.gains, found.delay, stability))
    gains = regulate(pendulum, weights_of(stability)).gains.transpose(1, 0, 2)
    assumed = basin_area(pendulum, gains, np.zeros(1), stability)[0]
    areas = {"low": max(low, 0), "high": high, "assumed": assumed}
    return _SAID["basin"].format(found=words, furthest=FURTHEST_DEG, **areas)
