"""What the page of a lift is made of: what `lumbar lift` writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd


@dataclass(frozen=True, eq=False)
class RecordedLift:
    """One analysed lift as tables.

    Attributes
    ----------
    body : pandas.DataFrame
        As of `lumbar.lifting.movement.body.body_frame`.
    pivot : numpy.ndarray, shape (n, 3), or None
        Of the pendulums at the instants of `body`, metres; None where the recording lacks its markers.
    states : pandas.DataFrame
        ``pendulum.csv``.
    facts : mapping
        ``pendulum.json``.
    events : mapping
        By name as of `lumbar.lifting.movement.event.Event.as_dict`.
    data : str
        Where the data come from.
    """

    body: pd.DataFrame
    pivot: np.ndarray | None
    states: pd.DataFrame
    facts: Mapping[str, Any]
    events: Mapping[str, Mapping[str, Any]]
    data: str

    @property
    def event_times(self) -> dict[str, float]:
        """Seconds, of the events that are known."""
        return {name: event["time_s"] for name, event in self.events.items() if event["time_s"] is not None}
