"""One thing that is wrong with a marker recording: which markers, when, the likely cause, and what is done about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ERROR, LEFT_OUT, PROPOSED, NOTED = "error", "left out", "proposed", "noted"
"""What a finding leads to: the trial stops; the stretch becomes a gap; an exchange of labels is proposed, and until somebody
exchanges them the stretch is a gap; nothing, it is said."""


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes
    ----------
    kind : str
        E.g. ``"frozen"``; docs/quality.md explains each.
    outcome : str
        ``"error"``, ``"left out"``, ``"proposed"`` or ``"noted"``.
    markers : tuple of str
        Labels of the file; empty where the whole recording is meant.
    first_frame, n_frames : int
        Frames count from 0.
    start_s : float
        Time of the first frame, on the recording's clock.
    length_s : float
        Frames divided by the rate.
    evidence : str
        What was seen, in numbers.
    cause : str
        What it most likely comes from, or what to do.
    """

    kind: str
    outcome: str
    markers: tuple[str, ...]
    first_frame: int
    n_frames: int
    start_s: float
    length_s: float
    evidence: str
    cause: str = ""

    @property
    def frames(self) -> slice:
        """The frames as a slice."""
        return slice(self.first_frame, self.first_frame + self.n_frames)

    def __str__(self) -> str:
        who = ", ".join(self.markers) or "all markers"
        when = f"{self.start_s:.2f} to {self.start_s + self.length_s:.2f} s"
        when += f" (frames {self.first_frame} to {self.frames.stop - 1})"
        return f"{self.kind}: {who}, {when}: {self.evidence}" + (f"; {self.cause}" if self.cause else "")


@dataclass(frozen=True)
class Clock:
    """Frames of a recording in seconds: makes findings.

    Attributes
    ----------
    time : ndarray, shape (n_frames,)
    rate : float
        Frames per second.
    """

    time: np.ndarray
    rate: float

    def finding(
        self,
        kind: str,
        outcome: str,
        markers: tuple[str, ...],
        evidence: str,
        cause: str = "",
        frames: slice | None = None,
    ) -> Finding:
        """Return a finding about some frames, or about all of them."""
        first, stop = (frames.start, frames.stop) if frames else (0, len(self.time))
        seconds = float(self.time[first]), (stop - first) / self.rate
        return Finding(kind, outcome, markers, int(first), int(stop - first), *seconds, evidence, cause)
