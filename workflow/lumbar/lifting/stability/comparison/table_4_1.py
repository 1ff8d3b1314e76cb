"""Table 4.1: percent differences of average cross-sections, published, in the thesis's wording, and as people stand.

It holds the published percentages beside those of this study under the thesis's own convention (`THESIS`) and
under the headline's. A basin that could not be computed is named in place of its number.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.basins import COLUMNS
from lumbar.lifting.stability.comparison.percent_differences import (
    Study,
    comparison_definition,
    headline_words,
    percent_differences,
    regulator_sentence,
)
from lumbar.lifting.stability.comparison.table_4_1_controls import controls_table, variants
from lumbar.lifting.stability.comparison.table_4_1_grid import (
    cells_under,
    grid_differences,
    survival_sentence,
)
from lumbar.lifting.stability.comparison.tuning_criterion import tuned_weights
from lumbar.lifting.stability.model.failures import TORQUE_LIMITED, failures_frame, join_rows
from lumbar.lifting.stability.model.trajectories import OPTIONS, PLANES, THESIS, Convention
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

THESIS_DECIMALS = 1
"""Digits after the point that the thesis's engine has in a percentage: with areas of the digits they have
(`eqs_4_5_to_4_7_alternation.RESOLUTION`) it may be off by some tenths."""

_LABELS = {"lateral_bending": "Lateral", "flexion_extension": "Flexion"}


def tables_4_1(
    study: Study, failures: pd.DataFrame | None = None
) -> tuple[Table, Table, pd.DataFrame, pd.DataFrame]:
    """Return Table 4.1, the table of its controls, the differences of its grid, and all basins that are missing.

    `failures` are the basins of the lifts that could not be computed, columns `failures.COLUMNS`; those returned are
    these and the controls'. The grid's differences are those of `grid_differences`.
    """
    groups = study.settings.compare.groups
    varied, failed = variants(study)
    missing = join_rows([*([] if failures is None else [failures]), failures_frame(failed)])
    own, thesis = (study.areas("exact", convention) for convention in (study.headline, THESIS))
    tuned = {
        "criterion": tuned_weights(study.trajectories(), study.headline.sign, own, study.settings),
        "thesis_criterion": tuned_weights(
            study.trajectories(convention=THESIS), THESIS.sign, thesis, study.settings
        ),
    }
    found = [item for item in tuned.values() if item is not None]
    missing = join_rows([missing, failures_frame([failure for item in found for failure in item.failures])])
    areas = {
        "thesis": (thesis, "mean_area"),
        "headline": (own, "mean_area"),
        "thesis_method": (study.areas("thesis", THESIS), "mean_area"),
        **{name: (frame, "mean_area") for name, frame in varied.items()},
        **{name: (item.areas if item else own[:0], "mean_area") for name, item in tuned.items()},
        "initial": (own, "initial_area"),
        "minimum": (own, "minimum_area"),
    }
    differences = {
        name: percent_differences(frame, column, study.people, groups)
        for name, (frame, column) in areas.items()
    }
    grid = grid_differences(study.grid, groups)
    table = _first_table(study, differences, grid, missing)
    return table, controls_table(study, differences, own, grid, tuned), grid, missing


def _first_table(
    study: Study, differences: dict[str, list[dict]], grid: pd.DataFrame, missing: pd.DataFrame
) -> Table:
    import pandas as pd

    settings = study.settings
    printed, rows = study.printed, []
    for index, row in enumerate(differences["headline"]):
        here = row["comparison"], row["com"]
        entry = dict(zip(("comparison", "com"), here, strict=True))
        entry |= {f"{plane}_percent": differences["thesis"][index][plane] for plane in PLANES}
        for plane in PLANES:
            entry[f"{plane}_published_percent"] = printed[f"{plane}_percent"].get(here, np.nan)
            if "thesis_method" in settings.checks:
                value = differences["thesis_method"][index][plane]
                entry[f"{plane}_thesis_method_percent"] = round(value, THESIS_DECIMALS)
            entry[f"{plane}_headline_percent"] = row[plane]
        rows.append(entry | {"status": row["status"]})
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent")]
    frame = frame.astype(dict.fromkeys(numbers, float))
    columns = _columns(settings)
    if (frame["status"] == "computed").all():
        columns["status"] = ("", columns["status"][1])
    return Table(
        title="Table 4.1: percent difference in average cross-sectional area of the basin of attraction.",
        frame=frame,
        definitions={name: definition for name, (_, definition) in columns.items()},
        data=study.data,
        notes=(
            survival_sentence(grid),
            published_sentence(study.published),
            *_null_notes(grid, study.headline),
            regulator_sentence(settings),
            *_missing_notes(missing),
        ),
        decimals=dict.fromkeys(numbers, 2)
        | {f"{plane}_thesis_method_percent": THESIS_DECIMALS for plane in PLANES},
        may_be_empty=frozenset(numbers),
        headers={name: header for name, (header, _) in columns.items() if header},
    )


def _columns(settings: StabilitySettings) -> dict[str, tuple[str, str]]:
    """Header, where it has one, and definition of every column."""
    own = headline_words(settings)
    kinds = {
        "published_percent": ("published", "percent difference in {} as the thesis prints it"),
        "percent": (
            "thesis's wording",
            f"the same in {{}} from this study's lifts in the thesis's wording ({THESIS}), exact method",
        ),
        "thesis_method_percent": (
            "",
            "as before in {} by the thesis's alternation (Eqs 4.5–4.7), which is no certificate; its areas, and so these "
            "percentages, have no more digits",
        ),
        "headline_percent": (
            own,
            f"headline: the same in {{}}, {own}, about the study's pivot, exact method",
        ),
    }
    columns = {
        "comparison": ("Comparison", comparison_definition(settings)),
        "com": ("Centre of mass", COLUMNS["com"]),
    }
    for plane, label in _LABELS.items():
        for kind, (header, definition) in kinds.items():
            header = f"{label}, {header} (%)" if header else ""
            columns[f"{plane}_{kind}"] = header, definition.format(plane.replace("_", " "))
    return columns | {"status": ("Status", "computed, or why the study cannot tell")}


def published_sentence(published: pd.DataFrame) -> str:
    """Say how the two published columns agree with one another, computed from them."""
    lateral, forward = (published[f"{plane}_percent"].to_numpy(float) for plane in PLANES)
    opposite = int((lateral * forward < 0).sum())
    return (
        f"The published columns correlate {np.corrcoef(lateral, forward)[0, 1]:+.2f} with one another, and {opposite} of "
        f"{len(lateral)} rows have opposite signs in the two planes. Mass and duration are the same in both planes and the "
        "length nearly so: no effect of mass, length and duration alone makes such columns"
    )


def _null_notes(grid: pd.DataFrame, own: Convention) -> list[str]:
    """Say for both signs what the differences owe to the movement, the headline's other choices kept."""
    notes = []
    for sign in OPTIONS["sign"]:
        rows = cells_under(grid, replace(own, sign=sign))
        if len(rows) > 2 and np.ptp(rows["percent"]) > 0 and np.ptp(rows["null_percent"]) > 0:
            correlation = np.corrcoef(rows["percent"], rows["null_percent"])[0, 1]
            notes.append(
                f"{sign.capitalize()}, {own.time} time, {own.mass.replace('_', ' ')}: correlation with the null "
                f"control {correlation:.3f}, at most {rows['movement_points'].abs().max():.2f} percentage points come from "
                "the movement"
            )
    return notes


def _missing_notes(missing: pd.DataFrame) -> tuple[str, ...]:
    """Name what is missing here: the basins with limited torque are none of this table's."""
    return tuple(
        f"Could not be computed and is left out: {row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}: "
        f"{row.basin}: {row.reason}"
        for row in missing.itertuples()
        if not row.basin.startswith(TORQUE_LIMITED)
    )
