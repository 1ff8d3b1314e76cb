"""What is chosen between a recording and its pendulums: the pivot, the ends of the trunk's segments, where the deposit starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from lumbar.settings.lifting import LiftingSettings

Chosen = TypeVar("Chosen")
OPTIONS = {
    "pivot": ("mid_ankle", "hip"),
    "segment_ends": ("inner", "skin"),
    "deposit_start": ("descent", "wrist_minimum"),
}
"""What conclusions are compared under. Pivots: the body over its feet, the trunk over its hips."""


@dataclass(frozen=True)
class PendulumChoice:
    """One way from the markers to the pendulums of a deposit; attributes as the keys of `LiftingSettings`."""

    pivot: str
    segment_ends: str
    deposit_start: str

    @classmethod
    def of(cls, settings: LiftingSettings) -> PendulumChoice:
        """Return a study's own."""
        return cls(settings.pivot, settings.segment_ends, settings.events.deposit_start)

    @property
    def others(self) -> list[PendulumChoice]:
        """What a study's own is compared with: the thesis's way, and either with one choice changed."""
        every = [item for item in (self, THESIS_CHOICE) for item in (item, *one_changed(item, OPTIONS))]
        return [item for item in dict.fromkeys(every) if item != self]


THESIS_CHOICE = PendulumChoice("mid_ankle", "skin", "wrist_minimum")
"""Of the pivot the thesis shows only Figure 4.1, a pendulum over the feet; its segments lie between markers, and its deposit
starts at the least speed of the wrists (section 4.2.3.1)."""


def one_changed(chosen: Chosen, options: Mapping[str, Sequence[str]]) -> Iterator[Chosen]:
    """Yield what differs from a set of choices in one of them."""
    for name in (field.name for field in fields(chosen)):
        for other in options[name]:
            if other != getattr(chosen, name):
                yield replace(chosen, **{name: other})
