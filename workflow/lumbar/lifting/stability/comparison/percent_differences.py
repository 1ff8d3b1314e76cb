"""The percent differences of Table 4.1: what a study compares, average cross-section by average cross-section."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.stability.model.trajectories import (
    COMS,
    PLANES,
    Convention,
    LiftStates,
    Trajectory,
    headline,
)
from lumbar.settings.stability import GROUPS, StabilitySettings

_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_name("table_4_1.yaml"))
LIGHTER_BOX = "decrease_in_mass_"
"""Start of the names of the comparisons of one lifter's lightest box with the heaviest."""


@dataclass(frozen=True)
class Study:
    """What the tables of a study are made of."""

    lifts: Sequence[LiftStates]
    """With ``experience`` among their facts."""
    boa: pd.DataFrame
    """``boa.csv`` of all lifts, with a column ``experience``."""
    settings: StabilitySettings
    published: pd.DataFrame
    """The thesis's Table 4.1."""
    source_label: str
    """Where the data come from."""

    @property
    def people(self) -> pd.DataFrame:
        """Label and box of every lift: it counts also where all its basins are missing."""
        return pd.DataFrame(
            [
                {"experience": lift.facts["experience"], "box_mass_kg": lift.facts["box_mass_kg"]}
                for lift in self.lifts
            ]
        )

    @property
    def printed(self) -> pd.DataFrame:
        """The thesis's percentages by comparison, as this study names it, and centre of mass."""
        named = self.published["comparison"].map(comparison_names(self.settings.compare.groups))
        return self.published.assign(comparison=named).set_index(["comparison", "com"])

    @property
    def headline(self) -> Convention:
        """The study's own convention: its lifts are made by the same settings."""
        return headline(self.settings, self.lifts[0].facts)

    def trajectories(self, mass=None, convention: Convention | None = None) -> list[Trajectory]:
        """Sound trajectories of all lifts, of the headline unless said; `mass` changes their masses (of the facts)."""
        lifts = self.lifts if mass is None else [replace(lift, facts=mass(lift.facts)) for lift in self.lifts]
        return [item for lift in lifts for item in lift.trajectories(convention or self.headline)[0]]

    def areas(self, method: str, convention: Convention) -> pd.DataFrame:
        """Rows of `boa` of one method and convention."""
        chosen = {"method": method, **vars(convention)}
        return self.boa[(self.boa[list(chosen)] == list(chosen.values())).all(axis=1)]


def comparisons(people: pd.DataFrame, groups: tuple[str, str] = GROUPS):
    """Yield name, (experience, mass) before and after, and whether the study can tell.

    `people` has columns ``experience`` and ``box_mass_kg``: a lift counts also where all its basins are missing. `groups`
    are the labels of the people compared, the first with the second.
    """
    lifts = {
        (str(name), float(mass))
        for name, mass in zip(people["experience"], people["box_mass_kg"], strict=True)
    }
    masses = {name: sorted(mass for who, mass in lifts if who == name) for name, _ in lifts}
    others = sorted(set(masses) - set(groups))
    first, second = groups
    between = "_vs_".join(groups)
    shared = set(masses.get(first, [])) & set(masses.get(second, []))
    absent = [name for name in groups if name not in masses]
    if absent:
        yield between, None, None, f"not testable: no {' and no '.join(absent)}"
    elif not shared:
        yield between, None, None, "not testable: no box mass in common"
    else:
        yield between, (second, max(shared)), (first, max(shared)), "computed"
    for name in (*groups, *others):
        found = masses.get(name, [])
        comparison = f"{LIGHTER_BOX}{name}"
        if len(found) > 1:
            yield comparison, (name, found[-1]), (name, found[0]), "computed"
        else:
            reason = f"one box mass ({found[0]:g} kg)" if found else f"no {name}"
            yield comparison, None, None, f"not testable: {reason}"


def percent_differences(
    areas: pd.DataFrame, column: str, people: pd.DataFrame, groups: tuple[str, str] = GROUPS
) -> list[dict]:
    """Compare average cross-sections as Table 4.1 does.

    Parameters
    ----------
    areas : pandas.DataFrame
        Columns ``experience, box_mass_kg, com, plane`` and `column`, of one method and sign. Several people
        and trials of the same experience are averaged.
    column : str
        The areas compared.
    people, groups
        As for `comparisons`.

    Returns
    -------
    list of dict
        ``comparison, com, status`` and, per plane, the percentage or NaN where the study cannot tell or a basin is
        missing; the status names it.
    """
    table = areas.groupby(["experience", "box_mass_kg", "com", "plane"])[column].mean().to_dict()
    rows = []
    for comparison, before, after, status in comparisons(people, groups):
        for com in COMS:
            row = {"comparison": comparison, "com": com, "status": status}
            gone = []
            for plane in PLANES:
                row[plane] = np.nan
                if status != "computed":
                    continue
                sides = [(*side, com, plane) for side in (before, after)]
                gone += [side for side in sides if side not in table]
                if all(side in table for side in sides):
                    base, other = (table[side] for side in sides)
                    row[plane] = float(100 * (other - base) / base)
            if gone:
                names = [f"{name} {mass:g} kg {com} {plane}" for name, mass, com, plane in gone]
                row["status"] = f"no basin: {', '.join(names)}"
            rows.append(row)
    return rows


def comparison_names(groups: tuple[str, str]) -> dict[str, str]:
    """Names of the comparisons of two groups by those that the thesis's Table 4.1 has them under.

    Examples
    --------
    >>> comparison_names(("trained", "untrained"))["expert_vs_novice"]
    'trained_vs_untrained'
    """
    between = {"_vs_".join(GROUPS): "_vs_".join(groups)}
    within = {
        f"{LIGHTER_BOX}{thesis}": f"{LIGHTER_BOX}{name}" for thesis, name in zip(GROUPS, groups, strict=True)
    }
    return between | within


def headline_words(settings: StabilitySettings) -> str:
    """Say the headline's sign, time and mass."""
    pendulum = settings.pendulum
    sign = {"inverted": "as people stand", "hanging": "hanging"}[pendulum.sign]
    return ", ".join([sign, f"{pendulum.time} time", pendulum.mass.replace("_", " ")])


def regulator_sentence(settings: StabilitySettings) -> str:
    """Say what regulator all basins have."""
    regulator, pendulum = settings.regulator, settings.pendulum
    weights = {
        "state": [list(row) for row in regulator.state_weight],
        "terminal": [list(row) for row in regulator.terminal_weight],
    }
    return _SAID["regulator"].format(regulator=regulator, damping=pendulum.damping_N_m_s, **weights)


def comparison_definition(settings: StabilitySettings) -> str:
    """Say what the comparisons are."""
    first, second = settings.compare.groups
    return _SAID["comparison"].format(first=first, second=second)
