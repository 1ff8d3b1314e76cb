"""Comparison of groups and of boxes, measure by measure: Welch's test on subject means, a paired test for two boxes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.tables.table import Table, table_from_schema

MIN_PERSONS = 3
"""Least number of subjects of a group for an interval."""


@dataclass(frozen=True)
class Difference:
    """Two means over persons and their difference, with a 95 % interval."""

    first: float
    """Mean of the first side over persons."""
    second: float
    """Mean of the second side over persons."""
    persons: tuple[int, int]
    """Number of persons of each side."""
    person_sd: float = np.nan
    """Standard deviation of the person means within the groups, or of the changes of paired persons."""
    low: float | None = None
    """Lower end of the interval of the difference; None without an interval."""
    high: float | None = None
    """Upper end of the interval of the difference; None without an interval."""
    freedom: float | None = None
    """Degrees of freedom of the test; None without a test."""
    p_value: float | None = None
    """Two-sided p value of the test; None without a test."""
    remark: str = ""
    """Reason if there is neither an interval nor a test; empty otherwise."""

    @property
    def difference(self) -> float:
        """First less second."""
        return self.first - self.second

    @property
    def percent(self) -> float | None:
        """Difference in per cent of `second`; None if a mean is not positive, as for a signed measure."""
        return 100 * self.difference / self.second if self.second > 0 else None


def compare_means(first: pd.Series, second: pd.Series, paired: bool, names: tuple[str, str]) -> Difference:
    """Compare the means of subjects, one value each.

    Parameters
    ----------
    first, second : pandas.Series
        Values by subject, in the same unit.
    paired : bool
        True to compare the changes of the subjects on both sides.
    names : tuple of str
        Names of the sides, for messages.
    """
    from statsmodels.stats.weightstats import CompareMeans, DescrStatsW

    if paired:
        shared = first.index.intersection(second.index)
        first, second, names = first[shared], second[shared], names[:1]
    persons = len(first), len(second)
    counts = dict(zip(names, persons, strict=False))
    short = [f"{n} person{'' if n == 1 else 's'} ({name})" for name, n in counts.items() if n < MIN_PERSONS]
    means = (float(side.mean()) if len(side) else np.nan for side in (first, second))
    if short:
        remark = f"no interval: {', '.join(short)}, at least {MIN_PERSONS} are needed"
        return Difference(*means, persons, remark=remark)
    sides = [DescrStatsW(first - second)] if paired else [DescrStatsW(first), DescrStatsW(second)]
    sd = float(np.sqrt(sum(side.sumsquares for side in sides) / sum(side.nobs - 1 for side in sides)))
    if not sd > 0:
        return Difference(*means, persons, sd, remark="no interval: all persons have the same value")
    if paired:
        interval, (_, p, freedom) = sides[0].tconfint_mean(), sides[0].ttest_mean()
    else:
        welch = CompareMeans(*sides)
        interval, (_, p, freedom) = welch.tconfint_diff(usevar="unequal"), welch.ttest_ind(usevar="unequal")
    low, high = map(float, interval)
    return Difference(*means, persons, sd, low=low, high=high, freedom=float(freedom), p_value=float(p))


@dataclass(frozen=True, eq=False)
class GroupComparison:
    """Comparison of one measure between two groups with one box, or between two boxes lifted by the same persons."""

    name: str
    box: str
    """Mass of the box in kg, or of both boxes: ``8 vs 15``."""
    measure: str
    plane: str
    unit: str
    safer: str
    """Direction of the safer values: ``higher``, ``lower`` or empty."""
    sides: tuple[str, str]
    """Names of the sides: groups, or masses of boxes."""
    paired: bool
    """True if the same persons are on both sides."""
    trials: tuple[int, int]
    """Number of lifts of each side."""
    difference: Difference

    @property
    def verdict(self) -> str:
        """Safer side, or a note that the interval contains 0."""
        low, high = self.difference.low, self.difference.high
        if low is None:
            return "no interval"
        if low <= 0 <= high:
            return "not decided"
        higher, lower = self.sides if low > 0 else self.sides[::-1]
        return {"higher": higher, "lower": lower}.get(self.safer, f"{higher} higher")


def compare_people(table: pd.DataFrame, groups: tuple[str, str]) -> Iterator[GroupComparison]:
    """Compare two groups with every box that both lifted, and the lightest with the heaviest box within each group.

    Parameters
    ----------
    table : pandas.DataFrame
        Columns ``person, group, box_mass_kg, measure, plane, value``, and ``unit`` and ``safer`` if they are known.
    groups : tuple of str
        Names of the two groups.
    """
    for (measure, plane), rows in table.groupby(["measure", "plane"], sort=False):
        unit, safer = (
            str(rows[name].fillna("").iloc[0]) if name in rows else "" for name in ("unit", "safer")
        )
        for name, box, sides, paired, selected in _pairs(rows, groups):
            first, second = (side.dropna(subset="value") for side in selected)
            means = (side.groupby("person")["value"].mean() for side in (first, second))
            difference = compare_means(*means, paired, sides)
            if all(difference.persons):
                yield GroupComparison(
                    name=name,
                    box=box,
                    measure=str(measure),
                    plane=str(plane),
                    unit=unit,
                    safer=safer,
                    sides=sides,
                    paired=paired,
                    trials=(len(first), len(second)),
                    difference=difference,
                )


def _pairs(rows: pd.DataFrame, groups: tuple[str, str]) -> Iterator[tuple]:
    """Yield for each comparison its name, boxes, names of the sides, whether it is paired, and the rows of either side."""
    cells = dict(list(rows.groupby(["group", "box_mass_kg"])))
    masses = {
        group: sorted(mass for name, mass in cells if name == group) for group in rows["group"].unique()
    }
    for mass in sorted(set(masses.get(groups[0], [])) & set(masses.get(groups[1], []))):
        yield "_vs_".join(groups), f"{mass:g}", groups, False, [cells[group, mass] for group in groups]
    for group, lifted in masses.items():
        if len(lifted) > 1:
            boxes = lifted[0], lifted[-1]
            box, sides = "{:g} vs {:g}".format(*boxes), tuple(f"{mass:g} kg" for mass in boxes)
            yield f"decrease_in_mass_{group}", box, sides, True, [cells[group, mass] for mass in boxes]


def comparison_table(comparisons: Sequence[GroupComparison], source_label: str) -> Table:
    """Return the differences between groups and boxes, with p values adjusted after Holm for each comparison and box."""
    from statsmodels.stats.multitest import multipletests

    rows: list[dict] = []
    families: dict[tuple[str, str], list[dict]] = {}
    for item in comparisons:
        difference = item.difference
        keys = {
            "comparison": item.name,
            "box_mass_kg": item.box,
            "measure": item.measure,
            "plane": item.plane,
        }
        means = {name: getattr(difference, name) for name in ("first", "second", "difference", "low", "high")}
        test = {"df": difference.freedom, "p": difference.p_value, "percent": difference.percent}
        texts = {
            "unit": item.unit or "not said",
            "safer": item.verdict,
            "remark": difference.remark or "none",
        }
        counts = {"persons": "{} + {}".format(*difference.persons), "trials": "{} + {}".format(*item.trials)}
        rows.append(keys | means | test | texts | counts)
        families.setdefault((item.name, item.box), []).extend(
            rows[-1:] if difference.p_value is not None else []
        )
    for tested in filter(None, families.values()):
        adjusted = multipletests([row["p"] for row in tested], method="holm")[1]
        for row, value in zip(tested, adjusted, strict=True):
            row["p_holm"] = value
    sizes = " or ".join(map(str, sorted(set(map(len, families.values())))))
    fields = {"fewest": MIN_PERSONS, "sizes": sizes or "no"}
    return table_from_schema("lifting/measures", "measure_comparison", rows, source_label, fields)
