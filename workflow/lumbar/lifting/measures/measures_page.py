"""The measures of all lifts as a page: one row per measure and plane, one column per group and box."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.files import write_csv, write_text
from lumbar.lifting.measures.registry import MEASURES
from lumbar.tables.table import SYNTHETIC_TWIN, Table
from lumbar.tables.words import value_in_words

if TYPE_CHECKING:
    import pandas as pd

_FIXED = {
    "measure": "its name in movement_measures.csv",
    "plane": "one of both planes, or all directions",
    "unit": "of the numbers",
    "safer": "which way is farther from a step, or kinder to the back",
}
SENSITIVITY = "Synthetic lifters show that the measures see movement; whether who moves so falls or aches sooner they cannot show"


def measures_page(values: pd.DataFrame, data: str) -> Table:
    """Tabulate the mean of every measure over the lifts of a group with one box.

    Parameters
    ----------
    values : pandas.DataFrame
        The long table, as of `lumbar.lifting.measures.lift_values.long_table`.
    data : str
        Where the data come from.
    """
    import pandas as pd

    cells = values.assign(column=values["group"] + " " + values["box_mass_kg"].map("{:g} kg".format))
    names = list(dict.fromkeys(cells["column"]))
    means = cells.groupby(["measure", "plane", "column"])["value"].mean()
    rows = [
        (
            measure.name,
            plane,
            measure.unit,
            measure.safer,
            *(means[measure.name, plane, name] for name in names),
        )
        for measure in MEASURES.values()
        for plane in measure.columns
    ]
    counts = cells.groupby("column")["lift"].nunique()
    definitions = {**_FIXED, **{name: f"mean of {counts[name]} lifts" for name in names}}
    notes = [
        f"{value_in_words(measure.name)} ({measure.symbol}): {measure.meaning}. Source: {measure.source}"
        for measure in MEASURES.values()
    ]
    absent = values[values["reason"] != ""]
    notes += [
        f"Absent, {row.lift}, {row.measure}: {row.reason}"
        for row in absent.drop_duplicates(["lift", "measure", "reason"]).itertuples()
    ]
    return Table(
        "Measures of the lifts that see their movement, over the deposit unless said.",
        pd.DataFrame(rows, columns=[*_FIXED, *names]),
        definitions,
        data,
        (*([SENSITIVITY] if data == SYNTHETIC_TWIN else []), *notes),
        may_be_empty=frozenset(names),
    )


def write_measures(stem: str | os.PathLike, values: pd.DataFrame, data: str) -> None:
    """Write ``stem.csv``, one row per lift, measure and plane, and the page as ``stem.tex`` and ``stem.html``."""
    stem, page = Path(stem), measures_page(values, data)
    write_csv(stem.with_name(f"{stem.name}.csv"), values.assign(data=data))
    write_text(stem.with_name(f"{stem.name}.tex"), page.to_latex())
    write_text(stem.with_name(f"{stem.name}.html"), page.to_html())
