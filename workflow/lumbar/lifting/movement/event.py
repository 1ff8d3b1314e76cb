"""One event of a lift: when it is, between which times it must lie, and how that was found."""

from __future__ import annotations

from dataclasses import asdict, dataclass

EVENTS = ("lift_off", "toe_off", "deposit_start", "release")
"""In the order in which they happen. Any of them may be absent: a lifter deposits without a step, or not at all."""
DETECTED, DECLARED, IN_FILE, ABSENT = "detected", "declared", "file", "absent"


@dataclass(frozen=True)
class Event:
    """One event and how it was found."""

    time_s: float | None
    """On the recording's clock; None for an event that does not happen or cannot be told."""
    method: str
    """{"detected", "declared", "file", "absent"}."""
    how: str
    """The rule and the numbers behind it, or why there is no such event, for the reader."""
    detected_s: float | None = None
    """What detection says where the event is declared by hand or taken from the file; None where it finds nothing."""
    earliest_s: float | None = None
    latest_s: float | None = None
    """`earliest_s`, `latest_s`: between these the event has happened whatever the threshold: the last instant of no
    movement in its direction, and a tenth of the way done; None where the rule knows no such instants."""
    thesis_s: float | None = None
    """What the thesis's own rule finds; None where it has no other, or finds nothing."""
    file_s: float | None = None
    """What the recording's own file says; None where it says nothing, or several things."""
    file: str = ""
    """The file's label, or which ones it has."""

    def as_dict(self) -> dict:
        """Plain data for JSON."""
        return asdict(self)
