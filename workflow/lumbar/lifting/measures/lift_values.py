"""One number per measure and plane of a lift: the long table that statistics and comparisons read, and its page."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.base.files import write_csv, write_text
from lumbar.lifting.measures.registry import (
    AT_RELEASE,
    CARRIED,
    DEPOSIT,
    FARTHEST,
    INTEGRAL,
    LARGEST,
    MEASURES,
    SMALLEST,
    WINDOWS,
    Measure,
)
from lumbar.tables.described import described
from lumbar.tables.layout import value_in_words
from lumbar.tables.table import SYNTHETIC_TWIN, Table

if TYPE_CHECKING:
    from lumbar.lifting.measures.course import Course

COLUMNS = (
    *("lift", "person", "group", "box_mass_kg", "trial"),
    *("measure", "plane", "value", "unit", "safer", "source", "reason"),
)
"""The contract of the long table: one row per lift, measure and plane. `value` is empty where it is absent, and `reason` says
why; `trial` counts the lifts of one person with one box."""


def values_of_lift(course: Course, facts: Mapping) -> pd.DataFrame:
    """Reduce the course of a lift to its measures: columns ``measure, plane, value, unit, safer, source, reason``.

    `facts` are those of `lumbar.lifting.measures.course.Lifter`, with ``start_s, stop_s`` of the deposit and ``no_deposit``, why
    there is none.
    """
    rows = []
    for measure in MEASURES.values():
        for plane, column in measure.columns.items():
            value, reason = _value(course, facts, measure, column)
            rows.append((measure.name, plane, value, measure.unit, measure.safer, measure.source, reason))
    return pd.DataFrame(rows, columns=list(COLUMNS[5:]))


def _value(course: Course, facts: Mapping, measure: Measure, column: str) -> tuple[float, str]:
    """The number and no reason, or none and why."""
    if column in course.missing:
        return np.nan, course.missing[column]
    within = _within(course, facts, measure.phase)
    if not within.any():
        return np.nan, facts["no_deposit"] if measure.phase == DEPOSIT else "the box is never held"
    time, values = (course.frame.loc[within, name].to_numpy(dtype=float) for name in ("time_s", column))
    if not np.isfinite(values).all():
        gone = ~np.isfinite(values)
        first = float(time[gone][0])
        return np.nan, (
            f"not known at {gone.sum()} of {len(values)} instants, the first at {first:.2f} s: a marker behind one of "
            f"{', '.join(course.unseen[column])} is not seen there, or no foot stands"
        )
    if measure.how == INTEGRAL:
        from scipy.integrate import trapezoid

        return float(trapezoid(values, time)), ""
    reduce = {
        SMALLEST: np.min,
        LARGEST: np.max,
        FARTHEST: lambda part: np.abs(part).max(),
        AT_RELEASE: lambda part: part[-1],
    }
    return float(reduce[measure.how](values)), ""


def _within(course: Course, facts: Mapping, phase: str) -> np.ndarray:
    """Which instants belong to a phase of the lift, shape (n,)."""
    if phase == CARRIED:
        return (course.frame["load_held"] == 1).to_numpy()
    return (course.frame["phase"] == "deposit").to_numpy() & (not facts["no_deposit"])


def long_table(lifts: Iterable[tuple[pd.DataFrame, Mapping]], labels: Mapping[str, str]) -> pd.DataFrame:
    """Join the measures of many lifts under the columns of `COLUMNS`.

    Each lift is its `values_of_lift` and its facts (``lift, subject, box_mass_kg``); `labels` are groups by person.
    """
    trials: Counter = Counter()
    frames = []
    for values, facts in lifts:
        key = facts["subject"], facts["box_mass_kg"]
        trials[key] += 1
        named = {
            "lift": facts["lift"],
            "person": facts["subject"],
            "group": labels.get(facts["subject"], ""),
            "box_mass_kg": float(facts["box_mass_kg"]),
            "trial": trials[key],
        }
        frames.append(values.assign(**named)[list(COLUMNS)])
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=list(COLUMNS))


SENSITIVITY = "Synthetic lifters show that the measures see movement; whether who moves so falls or aches sooner they cannot show"


def measures_page(values: pd.DataFrame, source_label: str) -> Table:
    """Tabulate the mean of every measure over the lifts of a group with one box, from the values of `long_table`."""
    cells = values.assign(column=values["group"] + " " + values["box_mass_kg"].map("{:g} kg".format))
    names = list(dict.fromkeys(cells["column"]))
    means = cells.groupby(["measure", "plane", "column"])["value"].mean()
    rows = [
        {"measure": measure.name, "plane": plane, "unit": measure.unit, "safer": measure.safer}
        | {name: means[measure.name, plane, name] for name in names}
        for measure in MEASURES.values()
        for plane in measure.columns
    ]
    words = {"lifts": cells.groupby("column")["lift"].nunique()}
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
    return described("lifting/measures", "measures", pd.DataFrame(rows), source_label, words, notes=notes)


def write_measures(stem: str | os.PathLike, values: pd.DataFrame, source_label: str) -> None:
    """Write ``stem.csv``, one row per lift, measure and plane, and the page as ``stem.tex`` and ``stem.html``."""
    stem, page = Path(stem), measures_page(values, source_label)
    write_csv(stem.with_name(f"{stem.name}.csv"), values.assign(data=source_label))
    write_text(stem.with_name(f"{stem.name}.tex"), page.to_latex())
    write_text(stem.with_name(f"{stem.name}.html"), page.to_html())
