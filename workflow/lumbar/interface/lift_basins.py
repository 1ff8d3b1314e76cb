"""``lumbar.basins``: from the pendulums of one lift to basins of attraction."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
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
from lumbar.settings.section import SEED
from lumbar.settings.stability import StabilitySettings


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
        Of `lift`, or a file ``pendulum.csv``.
    facts : mapping, optional
        Facts on the pendulums of a file; default ``pendulum.json`` next to it.
    seed : int
        Of the simulated starts.
    source_label : str
        Label of the data's source; default that of the lift.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.settings.stability import StabilitySettings
    >>> from lumbar.twin.examples import example_lift
    >>> lift = lumbar.lift("lift.c3d", example_lift("lift.c3d"), box_mass_kg=15)
    >>> exact_alone = StabilitySettings(knots=51, checks=())
    >>> basins = lumbar.basins(lift, settings=exact_alone)
    >>> print(basins)
    thorax, lateral_bending, inverted, real time: 0.4545 rad²/s on average, 0.6201 at first
    thorax, flexion_extension, inverted, real time: 0.4301 rad²/s on average, 0.5512 at first
    abdomen, lateral_bending, inverted, real time: 1.104 rad²/s on average, 1.745 at first
    abdomen, flexion_extension, inverted, real time: 1.065 rad²/s on average, 1.621 at first
    pelvis, lateral_bending, inverted, real time: 1.374 rad²/s on average, 2.101 at first
    pelvis, flexion_extension, inverted, real time: 1.338 rad²/s on average, 1.978 at first
    thorax, lateral_bending, hanging, unit time: 0.2661 rad²/s on average, 0.4697 at first
    thorax, flexion_extension, hanging, unit time: 0.266 rad²/s on average, 0.4696 at first
    abdomen, lateral_bending, hanging, unit time: 0.6729 rad²/s on average, 1.43 at first
    abdomen, flexion_extension, hanging, unit time: 0.6716 rad²/s on average, 1.427 at first
    pelvis, lateral_bending, hanging, unit time: 0.8726 rad²/s on average, 1.889 at first
    pelvis, flexion_extension, hanging, unit time: 0.8676 rad²/s on average, 1.876 at first
    """
    settings = settings or StabilitySettings()
    if isinstance(lift, Lift):
        states, source_label = (
            LiftStates(lift.states, lift.facts, lift.thesis_states),
            source_label or lift.source_label,
        )
    else:
        states = _read_states(Path(lift), facts)
        source_label = source_label or states.facts.get("data", "")
    return Basins(states, settings, seed, source_label or UNKNOWN_SOURCE)


def _read_states(path: Path, facts: Mapping | None) -> LiftStates:
    """Read ``pendulum.csv``, the facts next to it unless they are given, and ``thesis_pendulum.csv`` if it exists."""
    beside = path.with_suffix(".json")
    if facts is None and path.is_file() and not beside.is_file():
        raise InputError(
            f"{beside}: no such file; 'lumbar lift' makes {path} and it of a marker file: the states of a pendulum, and what it "
            "is made of"
        )
    facts = read_json(beside) if facts is None else facts
    in_thesis = path.with_name("thesis_pendulum.csv")
    read = partial(read_table, what="pendulum states")
    return LiftStates(read(path), facts, read(in_thesis) if in_thesis.is_file() else None)


@dataclass(frozen=True, eq=False, repr=False)
class Basins(Result):
    """Basins of attraction of one lift."""

    states: LiftStates
    settings: StabilitySettings
    seed: int
    source_label: str

    @cached_property
    def _found(self) -> tuple[list[Trajectory], list[Failure]]:
        return self.states.trajectories(headline(self.settings, self.states.facts))

    @property
    def trajectories(self) -> list[Trajectory]:
        """The sound trajectories of the headline."""
        return self._found[0]

    @cached_property
    def _basins(self) -> LiftBasins:
        """Areas, funnels and what could not be computed."""
        as_in_thesis, _ = self.states.trajectories(THESIS)
        return basins_of_lift(self.trajectories, self.settings, self.seed, as_in_thesis)

    @property
    def areas(self) -> pd.DataFrame:
        """One row per centre of mass, plane, method and sign of gravity, with the checks."""
        return self._basins.summary

    @property
    def funnels(self) -> pd.DataFrame:
        """Every funnel, knot by knot: of the headline's pendulums (``wording`` study) and of the thesis's, by method."""
        return self._basins.funnels

    def failures(self) -> pd.DataFrame:
        """Basins that could not be computed, with their reasons."""
        return failures_frame([*self._found[1], *self._basins.failures])

    def files(self) -> Iterator[tuple[str, Any]]:
        """``boa.csv``, ``funnel.csv`` and ``failures.csv``."""
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
        return f"<Basins of {len(self.trajectories)} pendulums>"

    @property
    def table(self) -> pd.DataFrame:
        """Areas, see `mean_areas`."""
        return self.mean_areas()

    def mean_areas(self) -> pd.DataFrame:
        """The areas by pendulum, method and sign, without their checks."""
        areas = [f"{which}_area" for which in ("mean", "initial", "minimum")]
        return self.areas[["com", "plane", "method", "sign", *areas, "proved_share"]]
