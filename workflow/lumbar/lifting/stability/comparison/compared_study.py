"""What Table 4.1 is made of, and its areas under every change that the headline is examined with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.comparison.grid import headline
from lumbar.lifting.stability.comparison.percent_differences import (
    TAYLOR_DEGREES,
    VARIANTS,
    taylor_areas,
    varied_areas,
)
from lumbar.lifting.stability.model.convention import Convention
from lumbar.lifting.stability.model.failures import Failure, all_or_each
from lumbar.lifting.stability.model.lift_trajectories import LiftStates
from lumbar.lifting.stability.model.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

BODY_MASS_SHARE = 0.1
"""By how much of it everybody's body mass is raised and lowered."""

_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")
TAYLOR = {f"taylor_{degree}": degree for degree in TAYLOR_DEGREES}
"""Degree of the sine's polynomial by change."""
CHANGES = {
    "null": "null control",
    "lighter": "lighter bodies",
    "heavier": "heavier bodies",
    "box_share": "the box shared the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
    **{name: f"Taylor degree {degree}" for name, degree in TAYLOR.items()},
}


@dataclass(frozen=True)
class Study:
    """What the tables of a study are made of."""

    lifts: Sequence[LiftStates]
    """With ``experience`` among their facts."""
    boa: pd.DataFrame
    grid: pd.DataFrame
    """`boa`, `grid`: ``boa.csv`` and ``grid.csv`` of all lifts, with a column ``experience``."""
    settings: StabilitySettings
    published: pd.DataFrame
    """The thesis's Table 4.1."""
    data: str
    """Where the data come from."""

    @property
    def people(self) -> pd.DataFrame:
        """Label and box of every lift: it counts also where all its basins are missing."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"experience": lift.facts["experience"], "box_mass_kg": lift.facts["box_mass_kg"]}
                for lift in self.lifts
            ]
        )

    def trajectories(self, mass=None) -> list[Trajectory]:
        """Sound trajectories of the headline, of all lifts; `mass` changes their masses (of the facts)."""
        lifts = self.lifts if mass is None else [replace(lift, facts=mass(lift.facts)) for lift in self.lifts]
        return [
            item
            for lift in lifts
            for item in lift.trajectories(headline(self.settings, lift.facts["pivot"]))[0]
        ]

    def areas(self, method: str, convention: Convention) -> pd.DataFrame:
        """Rows of `boa` of one method and convention (its pivot is the study's own)."""
        boa = self.boa
        return boa[
            (boa["method"] == method)
            & (boa["sign"] == convention.sign)
            & (boa["time"] == convention.time)
            & (boa["mass"] == convention.mass)
        ]


def _body_mass(factor: float):
    """Return what changes the masses of a lift's facts as if everybody weighed `factor` times as much."""

    def changed(facts):
        masses = {
            com: {"without_box": factor * own["without_box"]}
            | {"with_box": own["with_box"] + (factor - 1) * own["without_box"]}
            for com, own in facts["mass_kg"].items()
        }
        return {**facts, "mass_kg": masses}

    return changed


def _box_share(facts):
    """Share the box the other way: whole to every centre of mass instead of in proportion, or the reverse."""
    box, own = (
        float(facts["box_mass_kg"]),
        {com: item["without_box"] for com, item in facts["mass_kg"].items()},
    )
    whole = facts["box"]["share"] == "by_mass"
    masses = {
        com: {"without_box": mass, "with_box": mass + (box if whole else box * mass / sum(own.values()))}
        for com, mass in own.items()
    }
    return {**facts, "mass_kg": masses}


OTHER_MASSES = {
    "lighter": _body_mass(1 - BODY_MASS_SHARE),
    "heavier": _body_mass(1 + BODY_MASS_SHARE),
    "box_share": _box_share,
}


def variants(study: Study) -> tuple[dict[str, pd.DataFrame], list[Failure]]:
    """Return average cross-sections under every change that the headline is examined with.

    Returns
    -------
    areas : dict of str to pandas.DataFrame
        By change: ``subject, experience, box_mass_kg, com, plane, mean_area``.
    failures : list of Failure
        Areas that could not be computed: they have no row.
    """
    settings, trajectories = study.settings, study.trajectories()
    cases = dict.fromkeys(VARIANTS, trajectories) | {
        name: study.trajectories(mass) for name, mass in OTHER_MASSES.items()
    }
    # All of one kind at once are fastest; only where one has no basin is each computed by itself.
    try:
        at_once = varied_areas(cases, settings) if trajectories else {}
    except NumericalError:
        at_once = {}
    areas, failures = {}, []
    for name in (*VARIANTS, *TAYLOR, *OTHER_MASSES):
        items = cases.get(name, trajectories)
        if name in at_once:
            results = [(items, at_once[name])]
        else:
            results, failed = all_or_each(
                variant_areas, items, name, settings, basin=f"Table 4.1, {CHANGES.get(name, 'exact')}"
            )
            failures += failed
        areas[name] = _areas_frame(results)
    return areas, failures


def variant_areas(trajectories: list[Trajectory], name: str, settings: StabilitySettings) -> np.ndarray:
    """Average cross-sections of some trajectories under one change."""
    if name in TAYLOR:
        return taylor_areas(trajectories, settings, TAYLOR[name])
    return varied_areas({name: trajectories}, settings)[name]


def _areas_frame(results: list[tuple[list[Trajectory], np.ndarray]]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {name: getattr(item, name) for name in _KEYS} | {"mean_area": area}
        for items, areas in results
        for item, area in zip(items, areas, strict=True)
    ]
    return pd.DataFrame(rows, columns=[*_KEYS, "mean_area"])
