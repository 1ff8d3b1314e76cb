"""A tool that is not fastened to the tissue: it presses where it touches, never pulls, and the surface comes back by itself.

In contact the surface follows the tool. The tool leaves where the force would become negative; the free surface then
recovers as the tissue relaxes without force, until the tool meets it again. Positions count from the surface at rest.

All forces are in proportion to the stiffness of the tissue, so that contact begins and ends at times that hang on the
motion, on the tissue's time constant and on the share of its springs alone.
"""

from __future__ import annotations

import numpy as np

from lumbar.tissue.models.motion import Motion


def surface_of_branch(motion: Motion, share: float, time_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Position of the dashpot of a Maxwell branch beside a spring, under a tool that is not fastened.

    Force over the sum of both stiffnesses: x − (1 − share) w, with ẇ = (x − w)/τ; in contact x is the tool's
    position (linear between samples), else the force is 0: x = (1 − share) w.

    Parameters
    ----------
    share : float
        Stiffness of the spring over that of spring and branch, 0 to 1.
    time_constant : float
        τ of the branch in seconds.

    Returns
    -------
    numpy.ndarray, shape (samples,)
        w in the unit of the position.
    numpy.ndarray of bool, shape (samples,)
        Whether the tool touches the tissue.
    """
    rate = motion.sampling_time / time_constant
    decay, recovery = float(np.exp(-rate)), float(np.exp(-share * rate))
    mean = -np.expm1(-rate) / rate
    weights = [1.0 - mean, mean - decay]  # of the position now and a sample ago

    def followed(depth: np.ndarray, before: float, dashpot: float) -> np.ndarray:
        from scipy.signal import lfilter

        state = [weights[1] * before + decay * dashpot]
        return lfilter(weights, [1.0, -decay], depth, zi=state)[0]

    return _touches(motion.position, 1.0 - share, recovery, followed)


def surface_of_dashpot(motion: Motion, retardation_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Surface of a spring beside a dashpot under a tool that is not fastened, and whether the tool touches it.

    Force over stiffness: x + T v. The free surface comes back with the retardation time T.
    """
    position, velocity = motion.position, motion.velocity
    recovery = float(np.exp(-motion.sampling_time / retardation_time))
    pressing = position + retardation_time * velocity > 0
    ends = _next(~pressing | (position <= 0))
    surface, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    index, height = 0, 0.0
    while index < len(position):
        stop = ends[index] if position[index] > height and pressing[index] else index
        surface[index:stop], touching[index:stop] = position[index:stop], True
        if stop > index:
            height, index = float(position[stop - 1]) * recovery, stop
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


_AHEAD = 512
"""Samples that are looked at together."""


def _until_met(
    position: np.ndarray, allowed: np.ndarray | None, start: int, height: float, recovery: float
) -> int:
    """Samples from `start` on until a tool meets a surface that recovers from `height`."""
    for first in range(start, len(position), _AHEAD):
        piece = position[first : first + _AHEAD]
        met = piece > height * recovery ** (np.arange(len(piece)) + first - start)
        if allowed is not None:
            met &= allowed[first : first + _AHEAD]
        if met.any():
            return first - start + int(np.argmax(met))
    return len(position) - start


def _touches(position, following: float, recovery: float, followed) -> tuple[np.ndarray, np.ndarray]:
    """Dashpot and contact, from one meeting of tool and surface to the next."""
    dashpot, touching = np.zeros(len(position)), np.zeros(len(position), dtype=bool)
    ends = _next(position <= 0)
    index, now, before = 0, max(float(position[0]), 0.0), max(float(position[0]), 0.0)
    if position[0] > 0:
        dashpot[0], touching[0], index = now, True, 1
    while index < len(position):
        if touching[index - 1] if index else False:
            stop = min(ends[index] + 1, len(position))
            reached = followed(position[index:stop], before, now)
            pulls = position[index:stop] - following * reached <= 0
            count = int(np.argmax(pulls)) if pulls.any() else len(pulls)
            dashpot[index : index + count], touching[index : index + count] = reached[:count], True
            now = float(reached[count - 1]) if count else now
            index += count
            if index < len(position):  # it lets go at this sample
                now *= recovery
                dashpot[index] = now
                index += 1
        else:
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
