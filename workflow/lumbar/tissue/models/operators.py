"""Operators with memory, exact for the motion that each operator assumes between samples.

Rate-independent operators (play, presliding) have closed forms along a monotone interval of motion, so they are
evaluated from reversal to reversal and not from sample to sample.

A free tool, which is not fastened to the tissue, presses and never pulls. In contact the surface follows the tool, which leaves
when the force would become negative; the free surface then recovers until the tool meets it again. Positions are relative to the
surface at rest. Forces are proportional to the stiffness of the tissue, so that contact depends only on the motion, the tissue's
time constant and the ratio of its springs.
"""

import math
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import scipy

from lumbar.tissue.models.motion import SUBSTEPS, Motion
from lumbar.tissue.models.transfer_function import filtered


def relaxation(motion: Motion, time_constant: float) -> np.ndarray:
    """Return the elongation of the spring of a Maxwell branch with τ = b/k: q̇ = ẋ − q/τ, q(0) = 0.

    The result is exact if the velocity is a parabola between samples. A position that is not smooth is treated as piecewise
    linear between samples, or between substeps if they are known (ramp-invariant). Otherwise the interpolation error would
    appear as a force if τ is as short as the sampling time. Shape (samples,), in the unit of the position.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    time_constant : float or complex
        τ in seconds; complex for a pole of a conjugate pair at −1/τ.
    """
    rate = motion.sampling_time / time_constant
    constant = -np.expm1(-rate) / rate
    if motion.smooth:
        # Weights of the parabola's moments ∫e^{-(1-r)x} r^j dr, j = 0, 1, 2, with x the rate.
        linear = (1 - constant) / rate
        square = (1 - 2 * linear) / rate
        weights = np.array([constant - 3 * linear + 2 * square, 4 * (linear - square), 2 * square - linear])
        driven = (motion.sampling_time * weights) @ motion.velocities
    elif motion.between is not None:
        steps = np.diff(motion.between).reshape(-1, SUBSTEPS)
        short = rate / SUBSTEPS
        weights = -np.expm1(-short) / short * np.exp(-short * np.arange(SUBSTEPS - 1, -1, -1))
        driven = np.concatenate([[0.0], steps @ weights])
    else:
        driven = constant * motion.increments
    return filtered([1.0], [1.0, -np.exp(-rate)], driven)


def play(motion: Motion, gap: float) -> np.ndarray:
    """Return the position behind a gap (backlash), shape (samples,); it rests until the gap is closed.

    Play operator of Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989); it starts in the middle of the gap.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    gap : float
        Half-width of the gap, in the unit of the position.
    """
    position = motion.position
    turns = motion.turns
    place = float(turns[0])
    reached = [place]
    for low, high in zip((turns[1:] - gap).tolist(), (turns[1:] + gap).tolist(), strict=True):
        # Not min(max(...)): a search spends a twentieth of its time in this loop.
        if place < low:
            place = low
        elif place > high:
            place = high
        reached.append(place)
    return np.clip(np.array(reached)[motion.interval], position - gap, position + gap)


def presliding(motion: Motion, distance: float) -> np.ndarray:
    """Return Dahl's friction as a fraction r of its limit, −1 to 1, shape (samples,): dr/dx = (1 − r·sign ẋ)/d, r(0) = 0.

    P. Dahl, A solid friction model (1968), exponent 1; along a monotone interval r approaches ±1 exponentially with
    the presliding distance d.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    distance : float
        d, in the unit of the position.
    """
    position = motion.position
    turns = motion.turns
    steps = np.diff(turns)
    direction = np.sign(steps)
    share = [0.0]
    for sign, decay in zip(direction.tolist(), np.exp(-np.abs(steps) / distance).tolist(), strict=True):
        share.append(sign + (share[-1] - sign) * decay)
    interval = motion.interval
    start, sign = np.array(share)[interval], direction[interval]
    return sign + (start - sign) * np.exp(-np.abs(position - turns[interval]) / distance)


def bouc_wen(motion: Motion, distance: float) -> np.ndarray:
    """Return Bouc–Wen hysteresis with exponent 2 and β = γ as a fraction r of its limit, −1 to 1, shape (samples,).

    dr/dx = (1 − r²·[r ẋ > 0])/d: loading approaches the limit as a hyperbolic tangent, unloading is straight.
    Y. Wen, J. Eng. Mech. Div. 102 (1976) 249-263, with n = 2, β = γ = 1/2.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    distance : float
        d, in the unit of the position.
    """

    def load_one(share: float, travel: float) -> float:
        if share + travel < 0:
            return share + travel
        if share < 0:
            travel, share = travel + share, 0.0
        return min(math.tanh(math.atanh(share) + travel), _NEARLY_ONE)

    def load(share: np.ndarray, travel: np.ndarray) -> np.ndarray:
        loading = np.arctanh(np.maximum(share, 0.0)) + np.maximum(travel + np.minimum(share, 0.0), 0.0)
        return np.where(share + travel < 0, np.minimum(share + travel, 0.0), np.tanh(loading))

    return _follow_loop(motion, distance, load_one, load)


_NEARLY_ONE = 1 - 1e-12
_SCALAR = SimpleNamespace(maximum=max, minimum=min, log1p=math.log1p, expm1=math.expm1, exp=math.exp)
"""Functions for single numbers, ten times as fast as NumPy's."""
_MAX_EXPONENT = 50.0  # of a loop without a limit: no trial of a search overflows


def bouc_wen_general(motion: Motion, distance: float, unloading_share: float) -> np.ndarray:
    """Return Bouc–Wen hysteresis with exponent 1 and any β, γ, δ, as a fraction ρ of α/(2βγ), shape (samples,).

    ṙ = αv − β(γ|v|r + δv|r|) becomes dρ/dx = (1 + w|ρ| − [ρ ẋ > 0]|ρ|)/d, w = (γ − δ)/(2γ), d = 1/(2βγ) (the loop of the
    benchmark of Noël and Schoukens 2016, n = 1). Unloading relaxes exponentially at w, loading at 1 − w; above w = 1 loading
    gets steeper without a limit.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    distance, unloading_share : float
        d, in the unit of the position; w, above 0.
    """

    def load(library, share, travel):
        # 1 + w|ρ| decays below 0, 1 − (1 − w)ρ above.
        opposing, aiding = library.maximum(-share, 0.0), library.maximum(share, 0.0)
        until_zero = library.log1p(unloading_share * opposing) / unloading_share
        left = library.expm1(unloading_share * library.maximum(until_zero - travel, 0.0)) / unloading_share
        rest = library.maximum(travel - until_zero, 0.0)
        growth = unloading_share - 1.0
        exponent = library.minimum(growth * rest, _MAX_EXPONENT)
        added = library.expm1(exponent) / growth if growth else rest
        return aiding * library.exp(exponent) + added - left

    return _follow_loop(motion, distance, partial(load, _SCALAR), partial(load, np))


def _follow_loop(motion: Motion, distance: float, load_one: Callable, load: Callable) -> np.ndarray:
    """Return the friction at every sample, computed from reversal to reversal.

    `load_one` (for numbers) and `load` (for arrays) give the friction in the direction of motion, from the friction at the last
    reversal and the travel since then in presliding distances.
    """
    turns, interval = motion.turns, motion.interval
    steps = np.diff(turns)
    direction = np.sign(steps)
    share = [0.0]
    for sign, travel in zip(direction.tolist(), (np.abs(steps) / distance).tolist(), strict=True):
        share.append(sign * load_one(sign * share[-1], travel))
    sign = direction[interval]
    travelled = np.abs(motion.position - turns[interval]) / distance
    return sign * load(sign * np.array(share)[interval], travelled)


def elastoplastic(motion: Motion, distance: float) -> np.ndarray:
    """Return a Jenkins element (spring and slider in series) as a fraction of its limit, shape (samples,): (x − play)/distance.

    Parameters
    ----------
    motion : Motion
        Motion along one axis.
    distance : float
        Elongation at which the slider moves, in the unit of the position.
    """
    return (motion.position - play(motion, distance)) / distance


def surface_of_branch(motion: Motion, share: float, time_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the position w of the dashpot of a Maxwell branch parallel to a spring, and contact of the free tool; (samples,).

    The force over the sum of both stiffnesses is x − (1 − share) w, with ẇ = (x − w)/τ. In contact x is the tool's position
    (linear between samples); without contact the force is 0, so that x = (1 − share) w.

    Parameters
    ----------
    motion : Motion
        Motion along one axis, relative to the surface at rest.
    share, time_constant : float
        Stiffness of the spring over the sum of spring and branch, 0 to 1; τ of the branch in seconds.
    """
    rate = motion.sampling_time / time_constant
    decay, recovery = float(np.exp(-rate)), float(np.exp(-share * rate))
    mean = -np.expm1(-rate) / rate
    weights = [1.0 - mean, mean - decay]  # of the position now and a sample ago
    position, following = motion.position, 1.0 - share

    def follow(depth: np.ndarray, before: float, dashpot: float) -> np.ndarray:
        state = [weights[1] * before + decay * dashpot]
        return scipy.signal.lfilter(weights, [1.0, -decay], depth, zi=state)[0]

    dashpot, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    ends = _next_true(position <= 0)
    index, now, before = 0, max(float(position[0]), 0.0), max(float(position[0]), 0.0)
    if position[0] > 0:
        dashpot[0], touching[0], index = now, True, 1
    while index < len(position):
        if index and touching[index - 1]:
            # In contact: follow the tool until it leaves the surface at rest, or the force would become negative.
            stop = min(ends[index] + 1, len(position))
            reached = follow(position[index:stop], before, now)
            is_pulling = position[index:stop] - following * reached <= 0
            count = int(np.argmax(is_pulling)) if is_pulling.any() else len(is_pulling)
            dashpot[index : index + count], touching[index : index + count] = reached[:count], True
            now = float(reached[count - 1]) if count else now
            index += count
            if index < len(position):  # the tool leaves at this sample
                now *= recovery
                dashpot[index] = now
                index += 1
        else:
            # Free: the dashpot recovers exponentially until the tool meets the surface again.
            start = now * recovery if index else now
            count = _count_until_contact(position, None, index, following * start, recovery)
            dashpot[index : index + count] = start * recovery ** np.arange(count)
            now = start * recovery**count if count else start
            index += count
            if index < len(position):
                last = float(dashpot[index - 1]) if index else 0.0
                now = float(follow(position[index : index + 1], following * last, last)[0])
                dashpot[index], touching[index] = now, True
                index += 1
        before = float(position[index - 1])
    return dashpot, touching


def surface_of_dashpot(motion: Motion, retardation_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface of a spring parallel to a dashpot under a free tool, and contact of the tool; shape (samples,).

    The force over the stiffness is x + T v. The free surface recovers with the retardation time T.

    Parameters
    ----------
    motion : Motion
        Motion along one axis, relative to the surface at rest.
    retardation_time : float
        T in seconds.
    """
    position, velocity = motion.position, motion.velocity
    recovery = float(np.exp(-motion.sampling_time / retardation_time))
    is_pressing = position + retardation_time * velocity > 0
    ends = _next_true(~is_pressing | (position <= 0))
    surface, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    index, height = 0, 0.0
    while index < len(position):
        # In contact the surface is the tool's position, until the force or the depth would become negative.
        stop = ends[index] if position[index] > height and is_pressing[index] else index
        surface[index:stop], touching[index:stop] = position[index:stop], True
        if stop > index:
            height, index = float(position[stop - 1]) * recovery, stop
        # Free, it recovers until the tool meets it again.
        if index < len(position):
            count = _count_until_contact(position, is_pressing, index, height, recovery)
            surface[index : index + count] = height * recovery ** np.arange(count)
            height, index = height * recovery**count, index + count
    return surface, touching


def _next_true(condition: np.ndarray) -> list[int]:
    """Return for every sample the index of the first true sample at or after it; if there is none, the number of samples."""
    size = len(condition)
    return np.minimum.accumulate(np.where(condition, np.arange(size), size)[::-1])[::-1].tolist()


_BLOCK_SAMPLES = 512  # searched together


def _count_until_contact(
    position: np.ndarray, allowed: np.ndarray | None, start: int, height: float, recovery: float
) -> int:
    """Return the number of samples from `start` until a tool meets a surface that recovers from `height`."""
    for first in range(start, len(position), _BLOCK_SAMPLES):
        piece = position[first : first + _BLOCK_SAMPLES]
        is_met = piece > height * recovery ** (np.arange(len(piece)) + first - start)
        if allowed is not None:
            is_met &= allowed[first : first + _BLOCK_SAMPLES]
        if is_met.any():
            return first - start + int(np.argmax(is_met))
    return len(position) - start
