"""Percent differences of Table 4.1: comparisons of average cross-sections in a study."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    PLANES,
    Convention,
    LiftStates,
    Trajectory,
    headline,
)
from lumbar.settings.lifting import GROUPS, StabilitySettings

LIGHTER_BOX = "decrease_in_mass_"
"""Prefix of the names of comparisons of a lifter's lightest with the heaviest box."""
COMPUTED = "computed"


@dataclass(frozen=True)
class ComparedLifts:
    """Lifts of a study and their basins, for the tables."""

    lifts: Sequence[LiftStates]
    """Pendulum states of the lifts; their facts include ``experience``."""
    boa: pd.DataFrame
    """Rows of ``boa.csv`` of all lifts, with a column ``experience``."""
    settings: StabilitySettings
    published: pd.DataFrame
    """The thesis's Table 4.1."""
    source_label: str

    @property
    def comparisons(self) -> list["BasinComparison"]:
        """Comparisons of the study, including lifts without any basin."""
        lifts = [(lift.facts["experience"], lift.facts["box_mass_kg"]) for lift in self.lifts]
        return comparisons_of(lifts, self.settings.compare.groups)

    @property
    def published_percents(self) -> pd.DataFrame:
        """The thesis's percentages by centre of mass and comparison, under the study's names of comparisons."""
        named = self.published["comparison"].map(comparison_names(self.settings.compare.groups))
        return self.published.assign(comparison=named).set_index(["comparison", "com"])

    @property
    def headline(self) -> Convention:
        """Convention of the study; all its lifts have the same settings."""
        return headline(self.settings, self.lifts[0].facts)

    def trajectories(
        self,
        change_masses: Callable[[Mapping], Mapping] | None = None,
        convention: Convention | None = None,
    ) -> list[Trajectory]:
        """Return the valid trajectories of all lifts.

        Parameters
        ----------
        change_masses : callable, optional
            Returns a lift's facts with other masses.
        convention : Convention, optional
            Convention of the pendulums; default: the headline's.
        """
        lifts = self.lifts
        if change_masses is not None:
            lifts = [LiftStates(lift.states, change_masses(lift.facts), lift.in_thesis) for lift in lifts]
        return [item for lift in lifts for item in lift.trajectories(convention or self.headline)[0]]

    def areas(self, method: str, convention: Convention) -> pd.DataFrame:
        """Return the rows of `boa` of one method and convention.

        Parameters
        ----------
        method : {"exact", "thesis"}
            Method of the basins.
        convention : Convention
            Convention of the pendulums.
        """
        chosen = {"method": method, **vars(convention)}
        return self.boa[(self.boa[list(chosen)] == list(chosen.values())).all(axis=1)]

    def percent_differences(self, areas: pd.DataFrame, column: str = "mean_area") -> list[dict]:
        """Return `percent_differences` of the study's comparisons.

        Parameters
        ----------
        areas : pandas.DataFrame
            Rows of ``boa.csv`` of one method and convention.
        column : str, default "mean_area"
            Column with the areas that are compared.
        """
        return percent_differences(areas, column, self.comparisons)


@dataclass(frozen=True)
class BasinComparison:
    """One comparison of Table 4.1: of two groups, or of the heaviest and the lightest box of a group."""

    name: str
    before: tuple[str, float] | None = None
    """Experience and box mass in kg of the reference side; None if the study has no such lifts."""
    after: tuple[str, float] | None = None
    """Experience and box mass in kg of the other side."""
    status: str = COMPUTED
    """`COMPUTED`, or the reason why the study cannot make the comparison."""


def comparisons_of(
    lifts: Sequence[tuple[str, float]], groups: tuple[str, str] = GROUPS
) -> list[BasinComparison]:
    """Return the comparisons of groups and boxes; if a comparison is impossible, its status has the reason.

    Parameters
    ----------
    lifts : sequence of (str, float)
        Experience and box mass in kg of each lift.
    groups : tuple of str, default `GROUPS`
        Two groups; the first is compared with the second.
    """
    masses: dict[str, list[float]] = {}
    for name, mass in sorted({(str(name), float(mass)) for name, mass in lifts}):
        masses.setdefault(name, []).append(mass)
    first, second = groups
    shared = set(masses.get(first, [])) & set(masses.get(second, []))
    absent = [name for name in groups if name not in masses]
    name = "_vs_".join(groups)
    if absent:
        comparisons = [BasinComparison(name, status=f"not testable: no {' and no '.join(absent)}")]
    elif not shared:
        comparisons = [BasinComparison(name, status="not testable: no box mass in common")]
    else:
        comparisons = [BasinComparison(name, (second, max(shared)), (first, max(shared)))]
    for group in (*groups, *sorted(set(masses) - set(groups))):
        boxes, name = masses.get(group, []), f"{LIGHTER_BOX}{group}"
        if len(boxes) > 1:
            comparisons.append(BasinComparison(name, (group, boxes[-1]), (group, boxes[0])))
        else:
            reason = f"one box mass ({boxes[0]:g} kg)" if boxes else f"no {group}"
            comparisons.append(BasinComparison(name, status=f"not testable: {reason}"))
    return comparisons


def percent_differences(
    areas: pd.DataFrame, column: str, comparisons: Sequence[BasinComparison]
) -> list[dict]:
    """Compare average cross-sections as in Table 4.1.

    A row has ``comparison, com, status`` and the percentage per plane. If the study cannot make the comparison or lacks a basin,
    the percentage is NaN and the status has the reason.

    Parameters
    ----------
    areas : pandas.DataFrame
        Columns ``experience, box_mass_kg, com, plane`` and `column`, of one method and sign. Several people
        and trials of the same experience are averaged.
    column : str
        Column with the areas that are compared.
    comparisons : sequence of BasinComparison
        Comparisons of the study.
    """
    table = areas.groupby(["experience", "box_mass_kg", "com", "plane"])[column].mean().to_dict()
    rows = []
    for comparison in comparisons:
        for com in COMS:
            row = {"comparison": comparison.name, "com": com, "status": comparison.status}
            row |= dict.fromkeys(PLANES, np.nan)
            absent = []
            for plane in PLANES if comparison.status == COMPUTED else ():
                sides = [(*side, com, plane) for side in (comparison.before, comparison.after)]
                absent += [side for side in sides if side not in table]
                if all(side in table for side in sides):
                    base, other = (table[side] for side in sides)
                    row[plane] = float(100 * (other - base) / base)
            if absent:
                names = [f"{name} {mass:g} kg {com} {plane}" for name, mass, com, plane in absent]
                row["status"] = f"no basin: {', '.join(names)}"
            rows.append(row)
    return rows


def comparison_names(groups: tuple[str, str]) -> dict[str, str]:
    """Return the study's names of comparisons by the names in the thesis's Table 4.1.

    Parameters
    ----------
    groups : tuple of str
        The study's groups in the order of `GROUPS`.

    Examples
    --------
    >>> comparison_names(("trained", "untrained"))["expert_vs_novice"]
    'trained_vs_untrained'
    """
    pairs = zip(GROUPS, groups, strict=True)
    return {"_vs_".join(GROUPS): "_vs_".join(groups)} | {
        f"{LIGHTER_BOX}{thesis}": f"{LIGHTER_BOX}{name}" for thesis, name in pairs
    }


def headline_label(settings: StabilitySettings) -> str:
    """Return the sign, time and mass of the headline's convention as text.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    """
    pendulum = settings.pendulum
    sign = {"inverted": "as people stand", "hanging": "hanging"}[pendulum.sign]
    return ", ".join([sign, f"{pendulum.time} time", pendulum.mass.replace("_", " ")])


def regulator_note(settings: StabilitySettings) -> str:
    """Return a note on the regulator of all basins.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    """
    regulator, damping = settings.regulator, settings.pendulum.damping_N_m_s
    state = [list(row) for row in regulator.state_weight]
    terminal = [list(row) for row in regulator.terminal_weight]
    return (
        f"Regulator of all basins: Q = {state}, R = {regulator.control_weight:g}, Qf = {terminal}; b = {damping:g} N·m·s/rad; it "
        "is assumed, and the same for all"
    )


def comparison_definition(settings: StabilitySettings) -> str:
    """Return the definition of the comparisons.

    Parameters
    ----------
    settings : StabilitySettings
        Settings of the study.
    """
    first, second = settings.compare.groups
    return (
        f"{first}_vs_{second}: 100(A_{first} − A_{second})/A_{second} with the heaviest box of both; decrease_in_mass_…: "
        "100(A_light − A_heavy)/A_heavy with that lifter's heaviest and lightest box; A = (1/T)∫πρ/√det S dt in rad²/s"
    )
