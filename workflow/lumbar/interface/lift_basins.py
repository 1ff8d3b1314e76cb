"""``lumbar.basins``: from the pendulums of one lift to basins of attraction."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.interface.lift import Lift
from lumbar.interface.result import UNKNOWN_SOURCE, Result, read_table
from lumbar.lifting.stability.basins import LiftBasins, basins_of_lift
from lumbar.lifting.stability.model.pendulum_trajectories import (
    THESIS,
    Failure,
    LiftStates,
    Trajectory,
    failures_frame,
    headline,
)
from lumbar.settings.lifting import StabilitySettings
from lumbar.settings.section import SEED


def basins(
    lift: Lift | str | os.PathLike,
    *,
    facts: Mapping | None = None,
    settings: StabilitySettings | None = None,
    seed: int = SEED,
    source_label: str = "",
) -> "Basins":
    """Compute the basins of attraction of one lift, with the checks of the settings.

    Parameters
    ----------
    lift : Lift or path
        Result of `lift`, or a file ``pendulum.csv``.
    facts : mapping, optional
        Facts on the pendulums of a file; default ``pendulum.json`` next to it.
    settings : StabilitySettings, optional
        Pendulum, regulator, goal, knots and checks.
    seed : int
        Seed of the simulated starts.
    source_label : str
        Name of the source of the data; default the source of the lift.

    Raises
    ------
    InputError
        If `lift` did not write the file.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.settings.lifting import StabilitySettings
    >>> from lumbar.twin.examples import example_lift
    >>> lift = lumbar.lift("lift.c3d", example_lift("lift.c3d"), box_mass_kg=15)
    >>> basins = lumbar.basins(lift, settings=StabilitySettings(knots=51, checks=()))
    >>> print("\\n".join(str(basins).splitlines()[::6]))
    thorax, lateral_bending, inverted, real time: 0.4545 rad²/s on average, 0.6201 at first
    thorax, lateral_bending, hanging, unit time: 0.2661 rad²/s on average, 0.4697 at first
    """
    settings = settings or StabilitySettings()
    if isinstance(lift, Lift):
        states = LiftStates(lift.states, lift.facts, lift.thesis_states)
        return Basins(states, settings, seed, source_label or lift.source_label)
    path, kind = Path(lift), "pendulum states"
    facts_file, thesis_file = path.with_suffix(".json"), path.with_name("thesis_pendulum.csv")
    if facts is None and path.is_file() and not facts_file.is_file():
        raise InputError(f"{facts_file}: no such file; 'lumbar lift' writes it with {path}")
    facts = read_json(facts_file) if facts is None else facts
    thesis_states = read_table(thesis_file, kind) if thesis_file.is_file() else None
    states = LiftStates(read_table(path, kind), facts, thesis_states)
    return Basins(states, settings, seed, source_label or facts.get("data", "") or UNKNOWN_SOURCE)


@dataclass(frozen=True, eq=False, repr=False)
class Basins(Result):
    """Basins of attraction of one lift."""

    states: LiftStates
    settings: StabilitySettings
    seed: int
    source_label: str

    @cached_property
    def _trajectories(self) -> tuple[list[Trajectory], list[Failure]]:
        return self.states.trajectories(headline(self.settings, self.states.facts))

    @cached_property
    def _basins(self) -> LiftBasins:
        """Computed areas, funnels and failures."""
        thesis_trajectories, _ = self.states.trajectories(THESIS)
        return basins_of_lift(self._trajectories[0], self.settings, self.seed, thesis_trajectories)

    @property
    def areas(self) -> pd.DataFrame:
        """Areas with checks, one row per centre of mass, plane, method and sign of gravity."""
        return self._basins.summary

    @property
    def funnels(self) -> pd.DataFrame:
        """Funnels by method, one row per knot; ``wording`` is study (the headline's pendulums) or thesis."""
        return self._basins.funnels

    def failures(self) -> pd.DataFrame:
        """Return the basins that could not be computed, with their reasons."""
        return failures_frame([*self._trajectories[1], *self._basins.failures])

    @property
    def complete(self) -> bool:
        """True if every pendulum of the lift has its basin in the study's convention."""
        asked, computed = self.states.states, self.funnels.query("wording == 'study'")
        return 0 < len(asked.groupby(["com", "plane"])) == len(computed.groupby(["com", "plane"]))

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``boa.csv``, ``funnel.csv`` and ``failures.csv``."""
        yield "boa.csv", self.areas
        yield "funnel.csv", self.funnels
        yield "failures.csv", self.failures()

    def __str__(self) -> str:
        shown = self.areas[self.areas["method"] == "exact"]
        return "\n".join(
            f"{row.com}, {row.plane}, {row.sign}, {row.time} time: {row.mean_area:.4g} rad²/s on average, "
            f"{row.initial_area:.4g} at first"
            for row in shown.itertuples()
        )

    def __repr__(self) -> str:
        return f"<Basins of {len(self._trajectories[0])} pendulums>"

    @property
    def table(self) -> pd.DataFrame:
        """Areas by pendulum, method and sign, without checks."""
        areas = ["mean_area", "initial_area", "minimum_area"]
        return self.areas[["com", "plane", "method", "sign", *areas, "proved_share"]]
