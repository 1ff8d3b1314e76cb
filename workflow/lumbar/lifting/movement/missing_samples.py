"""Why samples of a centre of mass are missing: a gap of the file, or a finding that leaves a marker out; what helps."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from lumbar.lifting.movement.gaps import ISLAND, Gap
from lumbar.lifting.quality.sheet import Finding
from lumbar.records.markers import MarkerRecording

_LONGEST_S = 1.0
"""Longest gap that lifting.gaps.maximum_s may bridge."""


def why_missing(
    recording: MarkerRecording,
    needed: Collection[str],
    ends: Collection[str],
    frames: np.ndarray,
    gaps: Sequence[Gap],
    findings: Sequence[Finding],
) -> str:
    """Say which markers are missing and what helps: other frames are left out by findings than by gaps of the file.

    Parameters
    ----------
    recording : MarkerRecording
        Filtered; of the whole file or of a window of it.
    needed : collection of str
        Markers that the samples are computed from.
    ends : collection of str
        Those of them that ends of segments need; the pivot alone needs the others.
    frames : ndarray of int
        Missing samples, in order.
    gaps : sequence of Gap
        What was not seen after the findings' frames were left out.
    findings : sequence of Finding
        Of the recording.
    """
    start, stop = recording.time[frames[[0, -1]]]

    def there(item: Gap | Finding) -> bool:
        return item.start_s <= stop and item.start_s + item.length_s > start

    unseen = [name for name in needed if name in recording and not np.isfinite(recording[name][frames]).all()]
    causes = [finding for finding in findings if there(finding) and set(unseen) & set(finding.concerns)]
    open_gaps = [
        gap
        for gap in gaps
        if gap.marker in unseen
        and not gap.filled
        and gap.outcome != ISLAND
        and there(gap)
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


def _explained(gap: Gap, findings: Sequence[Finding]) -> bool:
    frames = set(range(gap.first_frame, gap.first_frame + gap.n_frames))
    for finding in findings:
        if gap.marker in finding.concerns:
            frames -= set(range(finding.frames.start, finding.frames.stop))
    return not frames
