"""The same pendulums about further pivots: what is concluded from them must not hang on where one sees them turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lumbar.base.errors import LumbarError
from lumbar.lifting.movement.lift import AnalysedLift, no_deposit, planar_frame
from lumbar.lifting.movement.pendulum_states import PendulumStates, pendulum_states, pivot_trajectory

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.lifting import LiftingSettings

COMPARED = ("mid_ankle", "hip")
"""Pivots that conclusions are compared about: the body over its feet, the trunk over its hips."""


@dataclass(frozen=True)
class OtherPivot:
    """Pendulums of a lift about one further pivot."""

    states: dict[tuple[str, str], PendulumStates]
    """By centre of mass and plane."""
    missing: dict[str, str]
    """Centres of mass without a pendulum about it, with the reason."""

    @property
    def facts(self) -> dict:
        """Mean lengths in m by centre of mass and plane, and what is missing; data for JSON."""
        lengths: dict[str, dict[str, float]] = {}
        for (com, plane), states in self.states.items():
            lengths.setdefault(com, {})[plane] = float(states.length.mean())
        return {"length_m": lengths, "missing": self.missing}


def other_pivots(lift: AnalysedLift, settings: LiftingSettings) -> dict[str, OtherPivot]:
    """Return the pendulums of the deposit about every pivot of `COMPARED` that is not the study's own."""
    return {name: _about(lift, name, settings) for name in COMPARED if name != settings.pivot}


def _about(lift: AnalysedLift, name: str, settings: LiftingSettings) -> OtherPivot:
    recording, states, missing = lift.recording, {}, {}
    without = no_deposit(lift.events)
    for com, centre in lift.centres.items():
        if without:
            missing[com] = without
            continue
        position = centre.position_with_box if settings.box.in_position else centre.position
        try:
            relative = position - pivot_trajectory(recording, lift.points, name)
            start, stop = lift.events["deposit_start"].time_s, lift.events["release"].time_s
            what = f"{recording.source}, {com}"
            found = pendulum_states(recording.time, relative, start, stop, settings.points, what)
        except LumbarError as error:
            missing[com] = str(error)
        else:
            states.update({(com, plane): values for plane, values in found.items()})
    absent = {com: reason for com, reason in lift.missing.items() if com not in lift.centres}
    return OtherPivot(states, {**absent, **missing})


def other_states_frame(pivots: dict[str, OtherPivot]) -> pd.DataFrame:
    """Pendulum states about the further pivots: column ``pivot`` and those of ``pendulum.csv``."""
    import pandas as pd

    frames = [planar_frame(about.states).assign(pivot=name) for name, about in pivots.items()]
    filled = [frame for frame in frames if len(frame)] or [planar_frame({}).assign(pivot="")]
    joined = pd.concat(filled, ignore_index=True)
    return joined[["pivot", *(name for name in joined.columns if name != "pivot")]]
