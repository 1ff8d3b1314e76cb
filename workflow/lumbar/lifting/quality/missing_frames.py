"""Frames that are missing without a gap: all markers leap together from one frame to the next."""

from __future__ import annotations

from collections import Counter
from functools import cached_property

import numpy as np

from lumbar.lifting.quality.finding import ERROR, Clock, Finding
from lumbar.lifting.quality.leaps import ABOVE_UNREST, Leap, step_sizes, unrest

_LEAST_LEAPS = 3
_LEAST_STEP_M = 3e-3
_TOGETHER = 0.5
"""Share of the markers that do not go on smoothly: what stands, as feet on the floor, does not leap where frames are missing."""
_SAME_FRAME = 2


def missing_frames(
    points: dict[str, np.ndarray], leaps: dict[str, list[Leap]], clock: Clock
) -> tuple[list[Finding], dict[str, list[Leap]]]:
    """Find the frames between which most markers leap, and return the other leaps.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Metres; NaN where not seen.
    leaps : dict of str to list of Leap
        By label, without exchanges of two markers.

    Returns
    -------
    findings : list of Finding
        Errors: which movement is missing, nobody knows.
    remaining : dict of str to list of Leap
    """
    counted = Counter(leap.first for found in leaps.values() for leap in found)
    findings: list[Finding] = []
    taken: list[int] = []
    sizes = _Sizes(points)
    for frame, count in counted.most_common():
        if count < _LEAST_LEAPS or any(abs(frame - other) <= _SAME_FRAME for other in taken):
            continue
        leaping, seen = _leaping(sizes, frame)
        if leaping >= max(_LEAST_LEAPS, _TOGETHER * seen):
            taken.append(frame)
            findings.append(_finding(frame, leaping, seen, clock))
    remaining = {
        label: [leap for leap in found if all(abs(leap.first - frame) > _SAME_FRAME for frame in taken)]
        for label, found in leaps.items()
    }
    return findings, remaining


class _Sizes:
    """Steps of all markers and the usual ones beside them, computed when a frame is first asked for."""

    def __init__(self, points: dict[str, np.ndarray]):
        self.points = points

    @cached_property
    def steps(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each marker the size of every step and its unrest there, shape (n_frames - 1,) each."""
        sizes = [step_sizes(positions) for positions in self.points.values()]
        return [(size, unrest(size)) for size in sizes]


def _leaping(sizes: _Sizes, frame: int) -> tuple[int, int]:
    """Count of the markers that do not go on smoothly into a frame, and of those seen about it."""
    leaping = seen = 0
    for size, usual in sizes.steps:
        if np.isfinite(size[frame - 1]):
            seen += 1
            leaping += bool(size[frame - 1] > max(_LEAST_STEP_M, ABOVE_UNREST * usual[frame - 1]))
    return leaping, seen


def _finding(frame: int, leaping: int, seen: int, clock: Clock) -> Finding:
    others = "; the others hardly move" if leaping < seen else ""
    evidence = f"all markers leap together at {clock.time[frame]:.2f} s ({leaping} of {seen}{others}): frames are missing there"
    cause = (
        "export the recording again with all its frames, or only the part before or after; markers that were not seen are to "
        "be gaps, not frames that are cut out"
    )
    return clock.finding("missing frames", ERROR, (), evidence, cause, slice(frame - 1, frame + 1))
