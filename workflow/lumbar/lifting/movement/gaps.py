"""Gaps in marker trajectories: found, filled where they are short, and reported.

A gap is a stretch of frames in which a marker was not seen. Short gaps between seen frames are bridged by a
cubic spline through the frames beside them. Nothing is extrapolated: a gap at the start or end of a recording
stays.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs

FILLED, TOO_LONG, AT_START, AT_END, ALONE, ISLAND = (
    "filled",
    "longer than allowed",
    "at the start",
    "at the end",
    "too few frames beside it",
    "seen too briefly to be filtered: left out",
)
SPLINE = "cubic spline"
CUT_OR_KEEP = (
    "cut the recording (window_s of the trial), give the marker an alias of others, or set gaps.longer: keep"
)
"""What helps a lift with a gap."""
_BESIDE = 2
"""Seen frames needed on each side of a gap: position and direction there."""


@dataclass(frozen=True)
class Gap:
    """A stretch of frames in which one marker was not seen."""

    marker: str
    first_frame: int
    n_frames: int
    """`first_frame`, `n_frames`: frames count from 0."""
    start_s: float
    """Time of the first missing frame, on the recording's clock."""
    length_s: float
    """Missing frames divided by the rate."""
    outcome: str
    """``"filled"``, or why it was not: ``"longer than allowed"``, ``"at the start"``, ``"at the end"``, ``"too few frames
    beside it"``; of frames that were seen, ``"seen too briefly to be filtered: left out"``."""
    method: str = ""
    """How it was filled; empty where it was not."""

    @property
    def filled(self) -> bool:
        """Whether the gap was bridged."""
        return self.outcome == FILLED


def fill_gaps(recording: MarkerRecording, maximum_s: float = 0.2) -> tuple[MarkerRecording, list[Gap]]:
    """Bridge short gaps by cubic splines.

    Each gap is bridged on its own, by the interpolating spline through the frames seen within `maximum_s` of
    its ends, so that a distant part of the recording has no influence.

    Parameters
    ----------
    maximum_s : float
        Longest gap that is filled, in seconds (missing frames divided by the rate); 0 fills none.

    Returns
    -------
    filled : MarkerRecording
        Seen frames are unchanged to the last bit; NaN where a gap stays.
    gaps : list of Gap
        Every gap, by marker and time.
    """
    if not (np.isfinite(maximum_s) and maximum_s >= 0):
        raise InputError(f"gaps.maximum_s is {maximum_s}; a number of seconds from 0 is needed")
    gaps: list[Gap] = []
    positions = {}
    for marker, points in recording.positions.items():
        positions[marker], found = _fill(marker, points, recording, maximum_s)
        gaps.extend(found)
    return replace(recording, positions=positions), gaps


def _fill(
    marker: str, points: np.ndarray, recording: MarkerRecording, maximum_s: float
) -> tuple[np.ndarray, list[Gap]]:
    seen = np.isfinite(points).all(axis=1)
    filled = points.copy()
    # At least the two frames on each side, however short the longest gap may be.
    reach = max(_BESIDE, round(maximum_s * recording.rate))
    gaps = []
    for gap in runs(~seen):
        length_s = (gap.stop - gap.start) / recording.rate
        first = max(0, gap.start - reach)
        before = first + np.flatnonzero(seen[first : gap.start])
        after = gap.stop + np.flatnonzero(seen[gap.stop : gap.stop + reach])
        outcome = _outcome(gap, len(points), length_s, maximum_s, min(len(before), len(after)))
        if outcome == FILLED:
            from scipy.interpolate import CubicSpline

            support = np.concatenate((before, after))
            spline = CubicSpline(recording.time[support], points[support])
            filled[gap] = spline(recording.time[gap])
        start_s, method = float(recording.time[gap.start]), SPLINE if outcome == FILLED else ""
        gaps.append(Gap(marker, gap.start, gap.stop - gap.start, start_s, length_s, outcome, method))
    return filled, gaps


def _outcome(gap: slice, n_frames: int, length_s: float, maximum_s: float, beside: int) -> str:
    if gap.start == 0:
        return AT_START
    if gap.stop == n_frames:
        return AT_END
    if length_s > maximum_s:
        return TOO_LONG
    return FILLED if beside >= _BESIDE else ALONE


def without_islands(recording: MarkerRecording, shortest: int) -> tuple[MarkerRecording, list[Gap]]:
    """Leave out frames between gaps that are too few to be filtered.

    Parameters
    ----------
    recording : MarkerRecording
        Short gaps filled.
    shortest : int
        A stretch must have more frames than this.

    Returns
    -------
    cleaned : MarkerRecording
    islands : list of Gap
        What was left out, with the outcome ``"seen too briefly to be filtered: left out"``.

    Raises
    ------
    InputError
        If the recording itself has no more frames.
    """
    if len(recording) <= shortest:
        raise InputError(
            f"{recording.source or recording.name}: {len(recording)} frames; the filter needs more than {shortest}"
        )
    positions, islands = {}, []
    for marker, points in recording.positions.items():
        short = [run for run in runs(np.isfinite(points).all(axis=1)) if run.stop - run.start <= shortest]
        positions[marker] = points.copy() if short else points
        for run in short:
            positions[marker][run] = np.nan
            frames, start_s = run.stop - run.start, float(recording.time[run.start])
            islands.append(Gap(marker, run.start, frames, start_s, frames / recording.rate, ISLAND))
    return replace(recording, positions=positions), islands


def refuse_open_gaps(
    recording: MarkerRecording,
    gaps: list[Gap],
    maximum_s: float,
    markers: Collection[str] | None = None,
    start_s: float = -np.inf,
    stop_s: float = np.inf,
    remedy: str = CUT_OR_KEEP,
) -> None:
    """Raise an error that lists the gaps left open in `markers` (default all) between two times, with what helps."""
    problems = Problems(recording.source or recording.name)
    for gap in gaps:
        concerns = (markers is None or gap.marker in markers) and (
            gap.start_s <= stop_s and gap.start_s + gap.length_s >= start_s
        )
        if concerns and not gap.filled:
            problems.add(
                gap.marker, f"not seen for {gap.length_s:.3g} s from {gap.start_s:.3f} s ({gap.outcome})"
            )
    if problems.entries:
        problems.add("", f"gaps up to {maximum_s:g} s between seen frames are filled", remedy)
    problems.raise_if_any()
