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
    """One analysed lift as tables."""

    body: pd.DataFrame
    """As of `lumbar.lifting.movement.body.body_frame`."""
    pivot: np.ndarray | None
    """Shape (n, 3), or None: of the pendulums at the instants of `body`, metres; None where the recording lacks its
    markers."""
    states: pd.DataFrame
    """``pendulum.csv``."""
    facts: Mapping[str, Any]
    """``pendulum.json``."""
    events: Mapping[str, Mapping[str, Any]]
    """By name as of `lumbar.lifting.movement.event.Event.as_dict`."""
    data: str
    """Where the data come from."""

    @property
    def event_times(self) -> dict[str, float]:
        """Seconds, of the events that are known."""
        return {name: event["time_s"] for name, event in self.events.items() if event["time_s"] is not None}
