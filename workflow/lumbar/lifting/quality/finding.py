"""One thing that is wrong with a marker recording: which markers, when, the likely cause, and what is done about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ERROR, LEFT_OUT, PROPOSED, NOTED = "error", "left out", "proposed", "noted"
"""What a finding leads to: the trial stops; the stretch becomes a gap; an exchange of labels is proposed, and until somebody
exchanges them the stretch is a gap; nothing, it is said."""
_AGAIN = "label it again in the capture software"
REMEDIES = {
    "beyond laboratory": "export it again, or take another marker in markers.aliases",
    "frozen": "delete the frozen frames in the capture software, where longer gaps can be filled",
    "copied": _AGAIN,
    "jump": f"{_AGAIN}, or take another marker in markers.aliases",
    "spike": _AGAIN,
    "off its part": f"{_AGAIN}, or take another marker in markers.aliases",
    "exchanged": "label both again in the capture software",
}
"""What brings back the frames that a finding leaves out, by its kind."""


@dataclass(frozen=True)
class Finding:
    """One finding."""

    kind: str
    """E.g. ``"frozen"``; docs/quality.md explains each."""
    outcome: str
    """``"error"``, ``"left out"``, ``"proposed"`` or ``"noted"``."""
    markers: tuple[str, ...]
    """Labels of the file; empty where the whole recording is meant."""
    first_frame: int
    n_frames: int
    """`first_frame`, `n_frames`: frames count from 0."""
    start_s: float
    """Time of the first frame, on the recording's clock."""
    length_s: float
    """Frames divided by the rate."""
    evidence: str
    """What was seen, in numbers."""
    cause: str = ""
    """What it most likely comes from, or what to do."""
    concerns: tuple[str, ...] = ()
    """Standard names that the markers fill, directly or by a rule."""

    @property
    def remedy(self) -> str:
        """What to do so that its frames can be used."""
        return REMEDIES[self.kind]

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
    """Frames of a recording in seconds: makes findings."""

    time: np.ndarray
    """Shape (n_frames,)."""
    rate: float
    """Frames per second."""

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
