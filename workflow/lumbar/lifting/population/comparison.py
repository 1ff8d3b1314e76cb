"""Groups of people and their boxes compared, measure by measure: who is safer, by how much, how certainly.

Groups are compared at the same box by a mixed-effects model with person as the random effect (`contrast`,
`variance_components`); two boxes are compared within the persons who lifted both.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.population.contrast import (
    Contrast,
    Interval,
    between_groups,
    cluster_bootstrap,
    within_persons,
)
from lumbar.lifting.population.variance_components import (
    ESTIMATED,
    PersonMeans,
    VarianceComponents,
    change_components,
    pair_up,
    variance_components,
)

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
    bootstrap: Interval
    """Of the difference."""

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


def compare_people(
    table: pd.DataFrame, groups: tuple[str, str], seed: int, resamples: int = 2000
) -> Iterator[Comparison]:
    """Compare two groups at every box that both lifted, and the lightest with the heaviest box in each group.

    The table has the columns `NEEDED`, may have ``unit`` and ``safer``; the first group is compared with the second.
    """
    check_long_table(table)
    for (measure, plane), rows in table.groupby(["measure", "plane"], sort=False):
        words = {name: str(rows[name].iloc[0]) if name in rows else "" for name in ("unit", "safer")}
        for name, box, sides, selected, paired in _pairs(rows, groups):
            values = tuple(_by_person(part) for part in selected)
            if not all(len(side) for side in values) or (
                paired and not set(values[0].persons) & set(values[1].persons)
            ):
                continue
            chance = [seed, zlib.crc32(f"{name} {box} {measure} {plane}".encode())]
            contrast, components, bootstrap = _compare(values, paired, sides, chance, resamples)
            missing = int(sum(part["value"].isna().sum() for part in selected))
            yield Comparison(
                name, box, str(measure), str(plane), words["unit"], words["safer"], sides, values, paired, missing,
                contrast, components, bootstrap,
            )  # fmt: skip


def _compare(values: tuple, paired: bool, sides: tuple[str, str], seed: list[int], resamples: int):
    if paired:
        contrast = within_persons(*values, name=sides[0])
        first, second = pair_up(*values)
        bootstrap = cluster_bootstrap(first.mean - second.mean, None, seed, resamples)
        return contrast, change_components(*values), bootstrap
    components = variance_components(list(values))
    contrast = between_groups(*values, components.variance_ratio, names=sides)
    return contrast, components, cluster_bootstrap(*(side.mean for side in values), seed, resamples)


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
