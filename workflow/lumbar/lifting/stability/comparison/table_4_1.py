"""Table 4.1: percent differences of average cross-sections, published, in the thesis's wording, and as people stand.

It holds the published percentages beside those of this study under the thesis's own convention (`THESIS`) and
under the headline's. A basin that could not be computed is named in place of its number.

Beside it stands the same by the thesis's method after one, two and four alternations: what of it its solver makes and not the
lifters. From the second alternation on ρ changes only at knots that have a multiplier again (`eqs_4_5_to_4_7_alternation`);
without these the table is that of one alternation, to the last digit.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.stability.basins import decimals
from lumbar.lifting.stability.comparison.percent_differences import (
    Study,
    comparison_definition,
    headline_words,
    percent_differences,
    regulator_sentence,
)
from lumbar.lifting.stability.comparison.table_4_1_controls import controls_table, variants
from lumbar.lifting.stability.model.failures import failures_frame, join_rows
from lumbar.lifting.stability.model.trajectories import PLANES, THESIS
from lumbar.lifting.stability.programme.eqs_4_5_to_4_7_alternation import EVIDENCE, RESOLUTION
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
THESIS_DECIMALS = 1
"""Digits after the point that the thesis's engine has in a percentage: with areas of the digits they have
(`eqs_4_5_to_4_7_alternation.RESOLUTION`) it may be off by some tenths."""


def tables_4_1(
    study: Study, parts: pd.DataFrame, failures: pd.DataFrame | None = None
) -> tuple[Table, Table, pd.DataFrame]:
    """Return Table 4.1, the table of its controls, and all basins that are missing.

    `parts` is that of `decomposition_table`. `failures` are the basins of the lifts that could not be computed, columns
    `failures.COLUMNS`; those returned are these and the controls'.
    """
    groups = study.settings.compare.groups
    varied, failed = variants(study)
    missing = join_rows([*([] if failures is None else [failures]), failures_frame(failed)])
    own, thesis = (study.areas("exact", convention) for convention in (study.headline, THESIS))
    areas = {
        "thesis": (thesis, "mean_area"),
        "headline": (own, "mean_area"),
        "thesis_method": (study.areas("thesis", THESIS), "mean_area"),
        **{name: (frame, "mean_area") for name, frame in varied.items()},
        "initial": (own, "initial_area"),
        "minimum": (own, "minimum_area"),
    }
    differences = {
        name: percent_differences(frame, column, study.people, groups)
        for name, (frame, column) in areas.items()
    }
    table = _first_table(study, differences, missing)
    return table, controls_table(study, differences, own, parts), missing


def _first_table(study: Study, differences: dict[str, list[dict]], missing: pd.DataFrame) -> Table:
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
    shown = [
        name for name in columns_of("lifting/stability", "table_4_1") if name in frame
    ]  # as the thesis pairs them
    if (frame["status"] == "computed").all():
        shown.remove("status")
    words = {
        "comparison": comparison_definition(settings),
        "thesis": THESIS,
        "headline": headline_words(settings),
    }
    return described(
        "lifting/stability",
        "table_4_1",
        frame,
        study.source_label,
        words,
        notes=(
            published_sentence(study.published),
            regulator_sentence(settings),
            *(_SAID["missing"].format(row=row) for row in missing.itertuples()),
        ),
        first=tuple(name for name in shown if not name.endswith("thesis_method_percent")),
    )


def published_sentence(published: pd.DataFrame) -> str:
    """Say how the two published columns agree with one another, computed from them."""
    lateral, forward = (published[f"{plane}_percent"].to_numpy(float) for plane in PLANES)
    opposite = int((lateral * forward < 0).sum())
    correlation = np.corrcoef(lateral, forward)[0, 1]
    return _SAID["published"].format(correlation=correlation, opposite=opposite, rows=len(lateral))


DECIMALS = 1
"""After the point: areas have two or three digits."""


def alternations_table(study: Study) -> Table:
    """Return the table of a study whose checks hold the thesis's method."""
    groups, own = study.settings.compare.groups, study.areas("thesis", THESIS)
    done = study.settings.thesis_method.alternations
    columns = {f"after_{number}": f"mean_area_after_{number}" for number in EVIDENCE} | {
        "thesis": "mean_area"
    }
    found = {name: percent_differences(own, column, study.people, groups) for name, column in columns.items()}
    found["exact"] = percent_differences(study.areas("exact", THESIS), "mean_area", study.people, groups)
    printed, rows = study.printed, []
    for index, row in enumerate(found["thesis"]):
        for plane in PLANES:
            entry = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            entry["published_percent"] = printed[f"{plane}_percent"].get(
                (row["comparison"], row["com"]), np.nan
            )
            entry |= {f"{name}_percent": float(found[name][index][plane]) for name in ("exact", *columns)}
            rows.append(entry)
    frame = pd.DataFrame(rows)
    return described(
        "lifting/stability",
        "table_4_1_alternations",
        frame[columns_of("lifting/stability", "table_4_1_alternations")],
        study.source_label,
        {"comparison": comparison_definition(study.settings), "done": done},
        notes=(
            jumps_sentence(own),
            sizes_sentence(frame, done),
            alternations_sentence(frame, done),
            *([digits_sentence(own)] if len(own) else []),
        ),
    )


def jumps_sentence(areas: pd.DataFrame) -> str:
    """Name the basins whose ρ a further alternation than the first changed, and what it does to their areas."""
    moved = areas[areas["jumped_knots"] > 0]
    if moved.empty:
        return _SAID["no_jumps"].format(basins=len(areas))
    each = []
    for row in moved.itertuples():
        percent, plane = 100 * (row.mean_area / row.mean_area_after_1 - 1), row.plane.replace("_", " ")
        where = _SAID["one_knot" if row.jumped_knots == 1 else "knots"].format(row=row)
        each.append(_SAID["jump"].format(row=row, plane=plane, where=where, percent=percent))
    return _SAID["jumps"].format(moved=len(moved), basins=len(areas), each="; ".join(each))


def digits_sentence(areas: pd.DataFrame) -> str:
    """Say what the digits of the thesis's areas leave of a difference."""
    step = max(100 * 10.0 ** -decimals(area, RESOLUTION["mean_area"]) / area for area in areas["mean_area"])
    return _SAID["digits"].format(step=step)


def sizes_sentence(frame: pd.DataFrame, done: int) -> str:
    """Compare the published sizes with those of one alternation and of all, plane by plane."""
    words = []
    for plane, rows in frame.groupby("plane", sort=False):
        sizes = [rows[f"{name}_percent"].abs().max() for name in ("published", "exact", "after_1", "thesis")]
        words.append(_SAID["sizes"].format(plane=plane.replace("_", " "), sizes=sizes, done=done))
    return f"Largest difference, {'; '.join(words)}"


def alternations_sentence(frame: pd.DataFrame, done: int) -> str:
    """Say whether a method that has converged stands behind the numbers: one alternation or four would then be the same."""
    other = 4 if done < 4 else 1
    change = (frame[f"after_{other}_percent"] - frame["thesis_percent"]).abs().max()
    words = f"{other} alternation{'s' if other > 1 else ''} in place of {done}"
    if not change >= 0.5 * 10**-DECIMALS:
        return f"{words}: no cell changes"
    return f"{words}: a cell changes by {change:.3g} percentage points, the alternation has not converged"
