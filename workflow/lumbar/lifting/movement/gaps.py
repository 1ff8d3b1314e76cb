"""Gaps in marker trajectories: found, filled where they are short, and reported, with what helps against those that stay.

A gap is a stretch of frames in which a marker was not seen. Short gaps between seen frames are bridged by a
cubic spline through the frames beside them. Nothing is extrapolated: a gap at the start or end of a recording
stays.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.lifting.quality.findings import MarkerFinding
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
_LONGEST_S = 1.0
"""Longest gap that lifting.gaps.maximum_s may bridge."""


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
    """Bridge gaps of up to `maximum_s` (missing frames divided by the rate) by cubic splines; 0 bridges none.

    Each gap is bridged on its own, by the interpolating spline through the frames seen within `maximum_s` of
    its ends, so that a distant part of the recording has no influence. Seen frames are unchanged to the last bit; NaN stays
    where a gap does. Every gap is returned beside the recording, by marker and time.
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
    """Leave out frames between gaps that are too few to be filtered, and say which: stretches of no more than `shortest`.

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


def within(item: Gap | MarkerFinding, start: float, stop: float) -> bool:
    """Whether a gap or a finding reaches between two times in seconds."""
    return item.start_s <= stop and item.start_s + item.length_s > start


def refuse_open_gaps(
    recording: MarkerRecording,
    gaps: list[Gap],
    maximum_s: float,
    markers: Collection[str] | None = None,
    start_s: float = -np.inf,
    stop_s: float = np.inf,
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
        problems.add("", f"gaps up to {maximum_s:g} s between seen frames are filled", CUT_OR_KEEP)
    problems.raise_if_any()


def why_missing(
    recording: MarkerRecording,
    needed: Collection[str],
    ends: Collection[str],
    frames: np.ndarray,
    gaps: Sequence[Gap],
    findings: Sequence[MarkerFinding],
) -> str:
    """Say which markers are missing and what helps: other frames are left out by findings than by gaps of the file.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered; of the whole file or of a window of it.
    needed, ends : collection of str
        Markers that the samples are computed from, and those of them that ends of segments need, not the pivot alone.
    frames : ndarray of int
        Missing samples, in order.
    gaps : sequence of Gap
        What was not seen after the findings' frames were left out.
    """
    start, stop = recording.time[frames[[0, -1]]]

    unseen = [name for name in needed if name in recording and not np.isfinite(recording[name][frames]).all()]
    causes = [
        finding
        for finding in findings
        if within(finding, start, stop) and set(unseen) & set(finding.concerns)
    ]
    open_gaps = [
        gap
        for gap in gaps
        if gap.marker in unseen
        and not gap.filled
        and gap.outcome != ISLAND
        and within(gap, start, stop)
        and not _explained(gap, causes)
    ]
    own = sorted({gap.marker for gap in open_gaps})
    said = [
        f"left out by the quality checks: {', '.join(finding.markers)} from {finding.start_s:.2f} to "
        f"{finding.start_s + finding.length_s:.2f} s ({finding.kind}): {finding.remedy}"
        for finding in causes
    ]
    if own or not causes:
        longest = max((gap.length_s for gap in open_gaps), default=0.0)
        said.append(
            (f"not seen in the file: {', '.join(own)}: " if own else "") + _advice(own, ends, longest)
        )
    return "; ".join(said)


def _advice(unseen: Collection[str], ends: Collection[str], longest_s: float) -> str:
    """What helps against gaps of these markers: another pivot only where no segment needs them."""
    bridged = f"raise lifting.gaps.maximum_s (a spline over {longest_s:.2g} s is a guess)"
    ways = [bridged if longest_s <= _LONGEST_S else "fill them in the capture software"]
    ways += ["use another pivot"] if not set(unseen) & set(ends) else []
    hips = bool(unseen) and all(name.endswith(("ASIS", "PSIS")) for name in unseen)
    ways += ["set lifting.segment_ends: skin, which needs no ASIS and PSIS"] if hips else []
    return ", or ".join(ways)


def _explained(gap: Gap, findings: Sequence[MarkerFinding]) -> bool:
    frames = set(range(gap.first_frame, gap.first_frame + gap.n_frames))
    for finding in findings:
        if gap.marker in finding.concerns:
            frames -= set(range(finding.frames.start, finding.frames.stop))
    return not frames
