"""Measures of a lift: unit, safer direction and source of each, one number per measure and plane, and their tables."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.base.files import write_csv, write_text
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.measures.back_load import TRUNK_SOURCE
from lumbar.lifting.measures.balance import ANKLE_SOURCE
from lumbar.tables.table import SYNTHETIC_TWIN, Table, table_from_schema
from lumbar.tables.table_layout import value_in_words

if TYPE_CHECKING:
    from lumbar.lifting.measures.course import Course


CARRIED, DEPOSIT = "carried", "deposit"
WINDOWS = {
    CARRIED: "from lift-off to release, or as far of it as was recorded",
    DEPOSIT: "from the start of the deposit to the release",
}
"""Phases of a lift for which measures are reduced to one number."""
SMALLEST, LARGEST, FARTHEST = "smallest", "largest", "farthest"
AT_RELEASE, INTEGRAL = "at_release", "integral"
"""Reductions of a course in time to one number: `FARTHEST` is the value with the largest distance from zero."""


@dataclass(frozen=True)
class Measure:
    """One measure of a lift."""

    name: str
    symbol: str
    unit: str
    safer: str
    """``higher`` or ``lower``: direction away from a step, or to a smaller load of the back; empty if neither is safer."""
    meaning: str
    """Meaning of the measure and of its sign, in one sentence."""
    source: str
    columns: dict[str, str] = field(hash=False)
    """Column of `lumbar.lifting.measures.course.course_of_lift` by plane."""
    how: str
    """Reduction of the course to one number, e.g. `AT_RELEASE`."""
    phase: str = DEPOSIT
    """Phase of the lift, one of `WINDOWS`."""
    headline: bool = False
    """True if a summary includes the measure."""


def headline_sentence(name: str, value: float, size: str) -> str:
    """Return the meaning of a headline measure's value for the lift.

    Parameters
    ----------
    name : str
        Name of the measure.
    value : float
        Its value in the measure's unit; only its sign is used.
    size : str
        The value without its sign, with the unit.
    """
    positive, negative = {
        "l5s1_moment_peak_carried": (f"The low back bears up to {size}.", ""),
        "lumbar_flexion_peak_carried": (
            f"The lumbar spine bends by up to {size} more than in standing.",
            "The lumbar spine never bends more than in standing.",
        ),
        "margin_of_stability": (
            f"The extrapolated centre stays inside the base, {size} from its edge.",
            f"The extrapolated centre leaves the base by {size}.",
        ),
        "smallest_impulse": (
            f"A push of {size} moves the extrapolated centre over the edge.",
            f"It is over the edge unless a push of {size} brings it back.",
        ),
    }[name]
    return negative if value < 0 else positive


def print_measure(name: str) -> str:
    """Return the printed name of a measure or plane: ``L5/S1 moment`` for ``l5s1_moment``."""
    text = name.replace("flexion_extension", "flexion/extension").replace("_", " ").replace("l5s1", "L5/S1")
    return text[:1].upper() + text[1:]


_CATALOGUE = shipped_yaml(Path(__file__).with_name("measures.yaml"))
_SOURCES: dict[str, str] = {"ankles": ANKLE_SOURCE, "strength": TRUNK_SOURCE}
for _name, _text in _CATALOGUE["sources"].items():
    _SOURCES[_name] = _text.format(**_SOURCES)
MEASURES = {
    name: Measure(name, **fields | {"source": fields["source"].format(**_SOURCES)})
    for name, fields in _CATALOGUE["measures"].items()
}
"""All measures by name, in the order of the tables."""


COLUMNS = (
    *("lift", "person", "group", "box_mass_kg", "trial"),
    *("measure", "plane", "value", "unit", "safer", "source", "reason"),
)
"""Columns of the long table, one row per lift, measure and plane. If `value` is empty, `reason` is given; `trial` numbers the
lifts of one subject with one box."""


def values_of_lift(course: Course, facts: Mapping) -> pd.DataFrame:
    """Reduce the course of a lift to its measures: columns ``measure, plane, value, unit, safer, source, reason``.

    Parameters
    ----------
    course : Course
        All measures at every instant.
    facts : mapping
        Facts of `lumbar.lifting.measures.course.Lifter`, with ``start_s, stop_s`` of the deposit and ``no_deposit``, the
        reason if it is missing.
    """
    rows = []
    for measure in MEASURES.values():
        for plane, column in measure.columns.items():
            value, reason = _value(course, facts, measure, column)
            rows.append((measure.name, plane, value, measure.unit, measure.safer, measure.source, reason))
    return pd.DataFrame(rows, columns=list(COLUMNS[5:]))


def _value(course: Course, facts: Mapping, measure: Measure, column: str) -> tuple[float, str]:
    """Return a measure's value and an empty reason, or NaN and the reason."""
    if column in course.missing:
        return np.nan, course.missing[column]
    if measure.phase == CARRIED:
        within, empty = (course.frame["load_held"] == 1).to_numpy(), "the box is never held"
    else:
        within, empty = (course.frame["phase"] == "deposit").to_numpy(), facts["no_deposit"]
        within = within & (not empty)
    if not within.any():
        return np.nan, empty
    time, values = (course.frame.loc[within, name].to_numpy(dtype=float) for name in ("time_s", column))
    if not np.isfinite(values).all():
        gone = ~np.isfinite(values)
        first = float(time[gone][0])
        return np.nan, (
            f"not known at {gone.sum()} of {len(values)} instants, the first at {first:.2f} s: a marker of one of "
            f"{', '.join(course.unseen[column])} is not seen there, or no foot is on the ground"
        )
    if measure.how == INTEGRAL:
        from scipy.integrate import trapezoid

        return float(trapezoid(values, time)), ""
    reduced = {
        SMALLEST: values.min(),
        LARGEST: values.max(),
        FARTHEST: np.abs(values).max(),
        AT_RELEASE: values[-1],
    }
    return float(reduced[measure.how]), ""


def long_table(lifts: Iterable[tuple[pd.DataFrame, Mapping]], labels: Mapping[str, str]) -> pd.DataFrame:
    """Join the measures of many lifts in one table with the columns `COLUMNS`.

    Parameters
    ----------
    lifts : iterable of (pandas.DataFrame, mapping)
        `values_of_lift` and facts (``lift, subject, box_mass_kg``) of each lift.
    labels : mapping of str to str
        Name of the group by subject.
    """
    trials: Counter = Counter()
    frames = []
    for values, facts in lifts:
        key = facts["subject"], facts["box_mass_kg"]
        trials[key] += 1
        person, group = facts["subject"], labels.get(facts["subject"], "")
        box, trial = float(facts["box_mass_kg"]), trials[key]
        lift = values.assign(lift=facts["lift"], person=person, group=group, box_mass_kg=box, trial=trial)
        frames.append(lift[list(COLUMNS)])
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=list(COLUMNS))


SENSITIVITY = "Synthetic lifters show that the measures depend on the movement; they cannot show who falls or has pain sooner"


def measures_page(values: pd.DataFrame, source_label: str) -> Table:
    """Tabulate the mean of every measure over the lifts of a group with one box, from a `long_table`."""
    cells = values.assign(column=values["group"] + " " + values["box_mass_kg"].map("{:g} kg".format))
    names = list(dict.fromkeys(cells["column"]))
    means = cells.groupby(["measure", "plane", "column"])["value"].mean()
    rows = [
        {"measure": measure.name, "plane": plane, "unit": measure.unit, "safer": measure.safer}
        | {name: means[measure.name, plane, name] for name in names}
        for measure in MEASURES.values()
        for plane in measure.columns
    ]
    fields = {"lifts": cells.groupby("column")["lift"].nunique()}
    notes = [SENSITIVITY] if source_label == SYNTHETIC_TWIN else []
    notes += [
        f"{value_in_words(measure.name)} ({measure.symbol}), {WINDOWS[measure.phase]}: {measure.meaning}. "
        f"Source: {measure.source}"
        for measure in MEASURES.values()
    ]
    absent = values[values["reason"] != ""]
    notes += [
        f"Absent, {', '.join(rows['lift'].unique())}, {', '.join(rows['measure'].unique())}: {reason}"
        for reason, rows in absent.groupby("reason", sort=False)
    ]
    return table_from_schema(
        "lifting/measures", "measures", pd.DataFrame(rows), source_label, fields, notes=notes
    )


def write_measures(stem: str | os.PathLike, values: pd.DataFrame, source_label: str) -> None:
    """Write ``stem.csv``, one row per lift, measure and plane, and the `measures_page` as ``stem.tex`` and ``stem.html``.

    Parameters
    ----------
    stem : str or os.PathLike
        Path without a suffix.
    values : pandas.DataFrame
        Result of `long_table`.
    source_label : str
        Source of the recordings, for the table's caption.
    """
    stem, page = Path(stem), measures_page(values, source_label)
    write_csv(stem.with_name(f"{stem.name}.csv"), values.assign(data=source_label))
    write_text(stem.with_name(f"{stem.name}.tex"), page.to_latex())
    write_text(stem.with_name(f"{stem.name}.html"), page.to_html())
