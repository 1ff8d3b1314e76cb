"""Groups of people and their boxes compared, measure by measure: who is safer, by how much, how certainly, and as published
tables, with how large a study has to be.

Groups are compared at the same box by a mixed-effects model with person as the random effect (`contrast`,
`variance_components`); two boxes are compared within the persons who lifted both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.population.contrast import (
    Contrast,
    between_groups,
    within_persons,
)
from lumbar.lifting.population.sample_size import (
    assured_sd,
    detectable_difference,
    persons_needed,
    sd_interval,
)
from lumbar.lifting.population.variance_components import (
    ESTIMATED,
    FEWEST_PERSONS,
    PersonMeans,
    VarianceComponents,
    change_components,
    variance_components,
)
from lumbar.settings.population import PopulationSettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

NEEDED = ("person", "group", "box_mass_kg", "measure", "plane", "value")
"""Columns of a long table, one row per lift, measure and plane; ``unit`` and ``safer`` (higher or lower) may be there."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One measure compared between two sides."""

    name: str
    """E.g. ``expert_vs_novice``, ``decrease_in_mass_expert``."""
    box: str
    """Mass of the box in kg, ``15 vs 23`` where boxes are compared."""
    measure: str
    plane: str
    unit: str
    safer: str
    """Which values are the safer ones: ``higher``, ``lower`` or empty."""
    sides: tuple[str, str]
    """What is compared with what."""
    values: tuple[PersonMeans, PersonMeans]
    paired: bool
    """Whether the same persons are on both sides."""
    missing: int
    """Trials without a value."""
    contrast: Contrast
    components: VarianceComponents
    """Of single trials or, `paired`, of the persons' changes and of single trials."""

    @property
    def verdict(self) -> str:
        """Which side is safer, or that the interval contains both answers."""
        interval = self.contrast.interval
        if not interval.is_known:
            return "cannot be told"
        if interval.low <= 0 <= interval.high:
            return "not decided"
        higher, lower = self.sides if self.contrast.difference > 0 else self.sides[::-1]
        return {"higher": higher, "lower": lower}.get(self.safer, f"{higher} higher")

    @property
    def remark(self) -> str:
        """What is to be known of this row."""
        return "; ".join(
            [
                *filter(None, [self.contrast.remark, self.contrast.percent_interval.remark]),
                *([self.components.status] if self.components.status != ESTIMATED else []),
                *([f"{self.missing} trials without a value"] if self.missing else []),
            ]
        )


def check_long_table(table: pd.DataFrame) -> None:
    """Check that a long table has what a comparison needs.

    Raises
    ------
    InputError
        For a column that is missing, and a person of two groups.
    """
    lacking = [name for name in NEEDED if name not in table]
    if lacking:
        raise InputError(
            f"no columns {', '.join(lacking)}; a comparison needs {', '.join(NEEDED)}, one row per lift and measure"
        )
    groups = table.groupby("person")["group"].nunique()
    if (groups > 1).any():
        raise InputError(f"{groups.idxmax()}: a person of {groups.max()} groups; each belongs to one")


def compare_people(table: pd.DataFrame, groups: tuple[str, str]) -> Iterator[Comparison]:
    """Compare two groups at every box that both lifted, and the lightest with the heaviest box in each group.

    The table has the columns `NEEDED`, may have ``unit`` and ``safer``; the first group is compared with the second.
    """
    check_long_table(table)
    for (measure, plane), rows in table.groupby(["measure", "plane"], sort=False):
        words = {
            name: str(rows[name].fillna("").iloc[0]) if name in rows else "" for name in ("unit", "safer")
        }
        for name, box, sides, selected, paired in _pairs(rows, groups):
            values = tuple(_by_person(part) for part in selected)
            if not all(len(side) for side in values) or (
                paired and not set(values[0].persons) & set(values[1].persons)
            ):
                continue
            contrast, components = _compare(values, paired, sides)
            missing = int(sum(part["value"].isna().sum() for part in selected))
            yield Comparison(
                name, box, str(measure), str(plane), words["unit"], words["safer"], sides, values, paired, missing,
                contrast, components,
            )  # fmt: skip


def _compare(values: tuple, paired: bool, sides: tuple[str, str]) -> tuple[Contrast, VarianceComponents]:
    if paired:
        return within_persons(*values, name=sides[0]), change_components(*values)
    components = variance_components(list(values))
    return between_groups(*values, components.variance_ratio, names=sides), components


def _pairs(rows: pd.DataFrame, groups: tuple[str, str]) -> Iterator[tuple]:
    """Name, boxes, names of the sides, their rows, and whether the same persons are on both."""
    cells = dict(list(rows.groupby(["group", "box_mass_kg"])))
    masses = {
        group: sorted(mass for name, mass in cells if name == group) for group in rows["group"].unique()
    }
    for mass in sorted(set(masses.get(groups[0], [])) & set(masses.get(groups[1], []))):
        yield "_vs_".join(groups), f"{mass:g}", groups, [cells[group, mass] for group in groups], False
    for group, found in masses.items():
        if len(found) > 1:
            light, heavy = found[0], found[-1]
            sides = f"{light:g} kg", f"{heavy:g} kg"
            selected = [cells[group, mass] for mass in (light, heavy)]
            yield f"decrease_in_mass_{group}", f"{light:g} vs {heavy:g}", sides, selected, True


def _by_person(rows: pd.DataFrame) -> PersonMeans:
    known = rows[rows["value"].notna()]
    return PersonMeans.of(
        {str(person): values.to_numpy() for person, values in known.groupby("person")["value"]}
    )


def comparison_table(comparisons: Sequence[Comparison], data: str) -> Table:
    """Return what differs between groups and boxes."""
    frame = pd.DataFrame(
        [_row(item) for item in comparisons], columns=columns_of(__file__, "measure_comparison")
    )
    numbers = frame.columns[frame.columns.get_loc("low") : frame.columns.get_loc("safer")]
    frame = frame.astype(dict.fromkeys(numbers, float))
    families = frame.groupby(["comparison", "box_mass_kg"], sort=False)["p"]
    adjusted, sizes = families.transform(_holm), sorted(set(families.count()))
    words = {"fewest": FEWEST_PERSONS, "sizes": " or ".join(map(str, sizes))}
    return described(__file__, "measure_comparison", frame.assign(p_holm=adjusted), data, words)


def _row(item: Comparison) -> dict:
    contrast, known = item.contrast, not item.contrast.remark
    return {
        **_keys(item),
        **{name: getattr(contrast, name) for name in ("first", "second", "difference", "percent")},
        "low": contrast.interval.low,
        "high": contrast.interval.high,
        "df": contrast.freedom if known else None,
        "p": contrast.p_value,
        "percent_low": contrast.percent_interval.low,
        "percent_high": contrast.percent_interval.high,
        "safer": item.verdict,
        "persons": _counts(map(len, item.values)),
        "trials": _counts(int(side.trials.sum()) for side in item.values),
        "remark": item.remark or "none",
    }


def _keys(item: Comparison) -> dict:
    return {
        "comparison": item.name,
        "box_mass_kg": item.box,
        "measure": item.measure,
        "plane": item.plane,
        "unit": item.unit or "not said",
    }


def _counts(numbers) -> str:
    return " + ".join(map(str, numbers))


def _holm(p_values):
    from statsmodels.stats.multitest import multipletests

    adjusted = p_values.copy()
    known = p_values.notna()
    if known.any():
        adjusted[known] = multipletests(p_values[known], method="holm")[1]
    return adjusted


def planning_table(comparisons: Sequence[Comparison], settings: PopulationSettings, data: str) -> Table:
    """Return scatter between people and trials, and how many persons a study needs.

    Raises
    ------
    InputError
        A measure of ``population.detect`` that there is none of.
    """
    measures = sorted({item.measure for item in comparisons})
    unknown = sorted(set(settings.detect) - set(measures))
    if unknown:
        raise InputError(
            f"population.detect: no measure {', '.join(unknown)}; measures: {', '.join(measures)}"
        )
    needed = {
        f"persons_with_{count}_trial{'' if count == 1 else 's'}": count for count in settings.planned_trials
    }
    texts = [name + end for name in needed for end in ("", "_low", "_high", "_assured")]
    *columns, remark = (
        name for name in columns_of(__file__, "measure_planning") if not name.startswith("persons_with")
    )
    columns += [*texts, remark]
    frame = pd.DataFrame([_planning_row(item, settings, needed) for item in comparisons], columns=columns)
    numbers = columns[columns.index("person_sd") : -1]
    # Counts with empty cells: as objects they print as whole numbers.
    frame = frame.astype({name: object if name in texts else float for name in numbers})
    return described(__file__, "measure_planning", frame, data, {"settings": settings})


def _planning_row(item: Comparison, settings: PopulationSettings, needed: dict[str, int]) -> dict:
    found, sd = item.components, item.contrast.person_mean_sd
    sought = settings.detect.get(item.measure) or settings.detect_percent / 100 * abs(item.contrast.second)
    options = {"paired": item.paired, "power_wanted": settings.power, "significance": settings.significance}
    size = min(map(len, item.values))
    known = np.isfinite(sd) and sd > 0 and not item.contrast.remark
    row = {
        **_keys(item),
        "person_sd": found.person_sd,
        "trial_sd": found.trial_sd,
        "person_mean_sd": sd if known else None,
        "sought": sought,
        "intraclass_correlation": found.intraclass_correlation,
        "detectable": detectable_difference(sd, size, **options) if known else None,
        "remark": item.remark or "none",
    }
    for name, trials in needed.items():
        planned = _planned_sd(item, trials)
        if planned and sought > 0:
            row[name] = persons_needed(sought, planned, **options)
        if row.get(name) and known:
            freedom = item.contrast.freedom
            low, high = sd_interval(planned, freedom)
            sds = {"_low": low, "_high": high, "_assured": assured_sd(planned, freedom, settings.assurance)}
            row |= {name + end: persons_needed(sought, value, **options) for end, value in sds.items()}
    return row


def _planned_sd(item: Comparison, trials: int) -> float | None:
    """Standard deviation of the means (changes) of persons with a number of trials, where it can be known."""
    counts = {int(count) for side in item.values for count in side.trials}
    if counts == {trials}:
        return item.contrast.person_mean_sd
    if item.components.person_sd is None or item.components.trial_sd is None:
        return None
    return float(
        np.hypot(item.components.person_sd, item.components.trial_sd * np.sqrt((1 + item.paired) / trials))
    )
