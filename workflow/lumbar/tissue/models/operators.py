"""Operators with memory, exact between samples for the stated motion.

Rate-independent operators (play, presliding) have closed forms along a monotone interval of motion, so they are
evaluated from reversal to reversal and not from sample to sample.

A tool that is not fastened to the tissue presses where it touches and never pulls; the surface comes back by itself. In
contact it follows the tool. The tool leaves where the force would become negative; the free surface then recovers as the tissue
relaxes without force, until the tool meets it again. Positions count from the surface at rest. All forces are in proportion to
the stiffness of the tissue, so that the times of contact depend only on the motion, on the tissue's time constant and on the
share of its springs.
"""

import math
from types import SimpleNamespace

import numpy as np
import scipy

from lumbar.tissue.models.motion import SUBSTEPS, Motion
from lumbar.tissue.models.transfer_function import filtered


def relaxation(motion: Motion, time_constant: float) -> np.ndarray:
    """Elongation of the spring of a Maxwell branch with τ = b/k: q̇ = ẋ − q/τ, q(0) = 0.

    Exact for a velocity that is a parabola between samples (from the spline's values at the samples and halfway); a
    position that is not smooth is taken as linear between samples, or in steps between them (ramp-invariant). A branch as
    fast as two samples would otherwise show the interpolation's error as a force.

    The result is in the unit of the position, shape (samples,). `time_constant` is τ in seconds; complex of one of a
    conjugate pair of poles at −1/τ.
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
    """Position behind a gap of half-width `gap` (backlash): it rests until the gap is closed.

    Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989), the play operator; at rest in the middle first.
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
    start = np.array(reached)[motion.interval]
    return np.clip(start, position - gap, position + gap)


def presliding(motion: Motion, distance: float) -> np.ndarray:
    """Dahl's friction as a share of its limit: dr/dx = (1 − r·sign ẋ)/d, r(0) = 0.

    P. Dahl, A solid friction model (1968), exponent 1; along a monotone interval r approaches ±1 exponentially with
    the presliding distance d.
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
    """Bouc–Wen hysteresis with exponent 2 and β = γ as a share of its limit.

    dr/dx = (1 − r²·[r ẋ > 0])/d: loading approaches the limit as a hyperbolic tangent, unloading is straight.
    Y. Wen, J. Eng. Mech. Div. 102 (1976) 249-263, with n = 2, β = γ = 1/2.
    """
    position = motion.position
    turns = motion.turns
    steps = np.diff(turns)
    direction = np.sign(steps)
    share = [0.0]
    for sign, travel in zip(direction.tolist(), (np.abs(steps) / distance).tolist(), strict=True):
        share.append(sign * _loaded_once(sign * share[-1], travel))
    interval = motion.interval
    begun = direction * np.array(share[:-1])
    sign, start, loaded = direction[interval], begun[interval], np.arctanh(np.maximum(begun, 0.0))[interval]
    travel = np.abs(position - turns[interval]) / distance
    unloading = np.minimum(start + travel, 0.0)
    loading = loaded + np.maximum(travel + np.minimum(start, 0.0), 0.0)
    return sign * np.where(start + travel < 0, unloading, np.tanh(loading))


_NEARLY_ONE = 1 - 1e-12


def _loaded_once(share: float, travel: float) -> float:
    """Share after `travel` (in presliding distances) in the positive direction, from `share` > −1.

    Below 0 it unloads in a straight line; above 0 it approaches 1 as a hyperbolic tangent.
    """
    if share + travel < 0:
        return share + travel
    if share < 0:
        travel, share = travel + share, 0.0
    return min(math.tanh(math.atanh(share) + travel), _NEARLY_ONE)


def bouc_wen_general(motion: Motion, distance: float, unloading_share: float) -> np.ndarray:
    """Bouc–Wen hysteresis with exponent 1 and any β, γ, δ, as a share of α/(2βγ).

    ṙ = αv − β(γ|v|r + δv|r|) becomes dρ/dx = (1 + w|ρ| − [ρ ẋ > 0]|ρ|)/d, w = (γ − δ)/(2γ), d = 1/(2βγ) (the loop of the
    benchmark of Noël and Schoukens 2016, n = 1). Unloading relaxes exponentially at w, loading at 1 − w; above w = 1 loading
    gets steeper without a limit.

    The result has shape (samples,). `distance` is d, in the unit of the position, `unloading_share` is w > 0.
    """
    position = motion.position
    turns = motion.turns
    steps = np.diff(turns)
    direction = np.sign(steps)
    share = [0.0]
    for sign, travel in zip(direction.tolist(), (np.abs(steps) / distance).tolist(), strict=True):
        share.append(sign * _loaded_generally(sign * share[-1], travel, unloading_share, _SCALAR))
    interval = motion.interval
    sign = direction[interval]
    travel = np.abs(position - turns[interval]) / distance
    return sign * _loaded_generally(sign * np.array(share)[interval], travel, unloading_share, np)


_LARGEST_GROWTH = 50.0  # exponent of a loop without a limit: no trial of a search overflows


_SCALAR = SimpleNamespace(maximum=max, minimum=min, log1p=math.log1p, expm1=math.expm1, exp=math.exp)
"""For one number: ten times as fast as NumPy's."""


def _loaded_generally(share, travel, unloading, library):
    """Share after `travel` in the positive direction: 1 + w|ρ| decays below 0, 1 − (1 − w)ρ above."""
    opposing, aiding = library.maximum(-share, 0.0), library.maximum(share, 0.0)
    until_zero = library.log1p(unloading * opposing) / unloading
    left = library.expm1(unloading * library.maximum(until_zero - travel, 0.0)) / unloading
    beyond = library.maximum(travel - until_zero, 0.0)
    growth = unloading - 1.0
    exponent = library.minimum(growth * beyond, _LARGEST_GROWTH)
    added = library.expm1(exponent) / growth if growth else beyond
    return aiding * library.exp(exponent) + added - left


def elastoplastic(motion: Motion, distance: float) -> np.ndarray:
    """Jenkins element (spring and slider in series) as a share of its limit: x less its play, over the distance."""
    return (motion.position - play(motion, distance)) / distance


def surface_of_branch(motion: Motion, share: float, time_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Position of the dashpot of a Maxwell branch parallel to a spring, under a tool that is not fastened.

    Force over the sum of both stiffnesses: x − (1 − share) w, with ẇ = (x − w)/τ; in contact x is the tool's
    position (linear between samples), else the force is 0: x = (1 − share) w.

    Returned are w in the unit of the position and whether the tool touches the tissue, both of shape (samples,).
    `share` is the stiffness of the spring over that of spring and branch, 0 to 1; `time_constant` is τ of the branch in
    seconds.
    """
    rate = motion.sampling_time / time_constant
    decay, recovery = float(np.exp(-rate)), float(np.exp(-share * rate))
    mean = -np.expm1(-rate) / rate
    weights = [1.0 - mean, mean - decay]  # of the position now and a sample ago

    def followed(depth: np.ndarray, before: float, dashpot: float) -> np.ndarray:
        state = [weights[1] * before + decay * dashpot]
        return scipy.signal.lfilter(weights, [1.0, -decay], depth, zi=state)[0]

    return _touches(motion.position, 1.0 - share, recovery, followed)


def surface_of_dashpot(motion: Motion, retardation_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Surface of a spring parallel to a dashpot under a tool that is not fastened, and whether the tool touches it.

    Force over stiffness: x + T v. The free surface comes back with the retardation time T.
    """
    position, velocity = motion.position, motion.velocity
    recovery = float(np.exp(-motion.sampling_time / retardation_time))
    pressing = position + retardation_time * velocity > 0
    ends = _next(~pressing | (position <= 0))
    surface, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    index, height = 0, 0.0
    while index < len(position):
        # In contact the surface is the tool's position, until the force or the depth would become negative.
        stop = ends[index] if position[index] > height and pressing[index] else index
        surface[index:stop], touching[index:stop] = position[index:stop], True
        if stop > index:
            height, index = float(position[stop - 1]) * recovery, stop
        # Free, it recovers until the tool meets it again.
        if index < len(position):
            count = _until_met(position, pressing, index, height, recovery)
            surface[index : index + count] = height * recovery ** np.arange(count)
            height, index = height * recovery**count, index + count
    return surface, touching


def _next(condition: np.ndarray) -> list[int]:
    """For every sample the index of the next one, itself included, for which a condition holds; else their number."""
    size = len(condition)
    index = np.where(condition, np.arange(size), size)
    return np.minimum.accumulate(index[::-1])[::-1].tolist()


_BLOCK_SAMPLES = 512  # samples that are searched together


def _until_met(
    position: np.ndarray, allowed: np.ndarray | None, start: int, height: float, recovery: float
) -> int:
    """Samples from `start` on until a tool meets a surface that recovers from `height`."""
    for first in range(start, len(position), _BLOCK_SAMPLES):
        piece = position[first : first + _BLOCK_SAMPLES]
        met = piece > height * recovery ** (np.arange(len(piece)) + first - start)
        if allowed is not None:
            met &= allowed[first : first + _BLOCK_SAMPLES]
        if met.any():
            return first - start + int(np.argmax(met))
    return len(position) - start


def _touches(position, following: float, recovery: float, followed) -> tuple[np.ndarray, np.ndarray]:
    """Dashpot and contact, interval by interval of contact and of free recovery."""
    dashpot, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    ends = _next(position <= 0)
    index, now, before = 0, max(float(position[0]), 0.0), max(float(position[0]), 0.0)
    if position[0] > 0:
        dashpot[0], touching[0], index = now, True, 1
    while index < len(position):
        if index and touching[index - 1]:
            # In contact: follow the tool until it leaves the surface at rest, or the force would become negative.
            stop = min(ends[index] + 1, len(position))
            reached = followed(position[index:stop], before, now)
            pulls = position[index:stop] - following * reached <= 0
            count = int(np.argmax(pulls)) if pulls.any() else len(pulls)
            dashpot[index : index + count], touching[index : index + count] = reached[:count], True
            now = float(reached[count - 1]) if count else now
            index += count
            if index < len(position):  # the tool leaves at this sample
                now *= recovery
                dashpot[index] = now
                index += 1
        else:
            # Free: the dashpot recovers exponentially until the tool meets the surface again.
            start_now = now * recovery if index else now
            count = _until_met(position, None, index, following * start_now, recovery)
            dashpot[index : index + count] = start_now * recovery ** np.arange(count)
            now = start_now * recovery**count if count else start_now
            index += count
            if index < len(position):
                last = float(dashpot[index - 1]) if index else 0.0
                now = float(followed(position[index : index + 1], following * last, last)[0])
                dashpot[index], touching[index] = now, True
                index += 1
        before = float(position[index - 1])
    return dashpot, touching
