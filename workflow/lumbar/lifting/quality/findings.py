"""Findings of the quality checks: markers, frames, evidence, likely cause and remedy."""

from dataclasses import dataclass, field

import numpy as np

ERROR, LEFT_OUT, PROPOSED, NOTED = "error", "left out", "proposed", "noted"
"""Outcomes of a finding: the trial stops; the interval becomes a gap; a correction is proposed, because the finding is not
certain; the finding is only reported. Nothing is left out because of the last two."""
_RELABEL = "label it again in the capture software"
_RELABEL_OR_REPLACE = f"{_RELABEL}, or name another marker in markers.aliases"
REMEDIES = {
    "beyond laboratory": "export the file again, or name another marker in markers.aliases",
    "frozen": "delete the frozen frames in the capture software, which can fill longer gaps",
    "jump": _RELABEL_OR_REPLACE,
    "spike": _RELABEL,
    "exchanged": "label both again in the capture software",
    "off its part": _RELABEL_OR_REPLACE,
    **dict.fromkeys(
        ("held", "missing frames", "restless", "mirrored", "static", "unit", "stature", "jitter"), ""
    ),
}
"""Remedies by kind of finding, to use frames again that it leaves out; empty if it leaves out none."""


@dataclass(frozen=True)
class MarkerFinding:
    """One finding of the quality checks."""

    kind: str
    """Kind of the finding, e.g. ``"frozen"``; docs/lifting/quality.md explains each."""
    outcome: str
    """Outcome: ``"error"``, ``"left out"``, ``"proposed"`` or ``"noted"``."""
    markers: tuple[str, ...]
    """Labels of the file; empty if the whole recording is meant."""
    first_frame: int
    """Index of the first frame, from 0."""
    n_frames: int
    """Number of frames."""
    start_s: float
    """Time of the first frame on the recording's clock."""
    length_s: float
    """Length of the interval: number of frames divided by the rate."""
    evidence: str
    """Measured numbers, as text."""
    cause: str = ""
    """Likely cause, or remedy."""
    concerns: tuple[str, ...] = ()
    """Standard names that are computed from the markers, directly or by a rule."""

    @property
    def remedy(self) -> str:
        """Return the remedy to use its frames again."""
        return REMEDIES[self.kind]

    @property
    def frames(self) -> slice:
        """Return the frames as a slice."""
        return slice(self.first_frame, self.first_frame + self.n_frames)

    def __str__(self) -> str:
        who = ", ".join(self.markers) or "all markers"
        when = f"{self.start_s:.2f} to {self.start_s + self.length_s:.2f} s"
        when += f" (frames {self.first_frame} to {self.frames.stop - 1})"
        return f"{self.kind}: {who}, {when}: {self.evidence}" + (f"; {self.cause}" if self.cause else "")


@dataclass(frozen=True)
class Legend:
    """Times of the frames of a recording and meanings of its labels; makes findings."""

    time: np.ndarray
    """Shape (n_frames,): time, seconds."""
    rate: float
    """Frames per second."""
    named: dict[str, str] = field(default_factory=dict)
    """Landmark that each label means."""

    def finding(
        self,
        kind: str,
        outcome: str,
        evidence: str,
        cause: str,
        markers: tuple[str, ...] = (),
        frames: slice | None = None,
    ) -> MarkerFinding:
        """Return a finding about some frames.

        Parameters
        ----------
        kind : str
            Key of `REMEDIES`.
        outcome : {"error", "left out", "proposed", "noted"}
            Consequence of the finding.
        evidence, cause : str
            Measured numbers as text; likely cause or remedy.
        markers : tuple of str, default ()
            Labels of the file; empty if the whole recording is meant.
        frames : slice, optional
            Frames of the recording; default: all.
        """
        first, stop = (int(frames.start), int(frames.stop)) if frames else (0, len(self.time))
        length_s = (stop - first) / self.rate
        return MarkerFinding(
            kind, outcome, markers, first, stop - first, float(self.time[first]), length_s, evidence, cause
        )
