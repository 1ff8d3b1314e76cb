"""Table 4.1: percent differences of average cross-sections as published, under the thesis's convention, and under the headline's.

The thesis's convention is `THESIS`. A basin that could not be computed is named in place of its percentage.

The table of controls reports for each difference the share that comes from the movement, the null control, the range under
changes of weights, damping, body mass and sharing of the box one at a time, and whether it survives these controls.

The table of alternations has the percentages by the thesis's method after one, two and four alternations, to show the effect of
its solver. From the second alternation ρ changes only at knots that have a multiplier again (`eqs_4_5_to_4_7_alternation`).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.lifting.measures.compare_groups import Difference, compare_means
from lumbar.lifting.stability.basins import decimals
from lumbar.lifting.stability.changed_pendulums import (
    BODY_MASS_SHARE,
    CHANGES,
    NULL_CONTROL,
    areas_under_changes,
)
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_alternation import EVIDENCE, RESOLUTION
from lumbar.lifting.stability.model.pendulum_trajectories import PLANES, THESIS, failures_frame, join_rows
from lumbar.lifting.stability.percent_differences import (
    COMPUTED,
    BasinComparison,
    ComparedLifts,
    comparison_definition,
    headline_label,
    regulator_note,
)
from lumbar.tables.table import Table, columns_of, table_from_schema

MOVEMENT_SHARE = 0.5
"""Least share of a difference from the movement (not from duration, mass and length) for the difference to survive."""


@dataclass(frozen=True)
class Tables41:
    """Table 4.1 of a study."""

    table: Table
    controls: Table
    missing: pd.DataFrame
    """All missing basins, as rows of ``failures.csv``."""


def tables_4_1(study: ComparedLifts, parts: pd.DataFrame, failures: pd.DataFrame | None = None) -> Tables41:
    """Return Table 4.1, the table of its controls, and all missing basins.

    Parameters
    ----------
    study : ComparedLifts
        Lifts of the study and their basins.
    parts : pandas.DataFrame
        Result of `decomposition_table`.
    failures : pandas.DataFrame, optional
        Missing basins of the lifts, rows of ``failures.csv``; missing basins of the controls are added.
    """
    varied, failed = areas_under_changes(study)
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
    differences = {name: study.percent_differences(frame, column) for name, (frame, column) in areas.items()}
    table = _first_table(study, differences, missing)
    return Tables41(table, _controls_table(study, differences, own, parts), missing)


def _first_table(study: ComparedLifts, differences: dict[str, list[dict]], missing: pd.DataFrame) -> Table:
    """Return the percentages as published, under the thesis's convention and under the headline's."""
    settings = study.settings
    published, rows = study.published_percents, []
    for index, row in enumerate(differences["headline"]):
        here = row["comparison"], row["com"]
        entry = dict(zip(("comparison", "com"), here, strict=True))
        entry |= {f"{plane}_percent": differences["thesis"][index][plane] for plane in PLANES}
        for plane in PLANES:
            entry[f"{plane}_published_percent"] = published[f"{plane}_percent"].get(here, np.nan)
            if "thesis_method" in settings.checks:
                value = differences["thesis_method"][index][plane]
                entry[f"{plane}_thesis_method_percent"] = _round_to_points(value)
            entry[f"{plane}_headline_percent"] = row[plane]
        rows.append(entry | {"status": row["status"]})
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent")]
    frame = frame.astype(dict.fromkeys(numbers, float))
    shown = [name for name in columns_of("lifting/stability", "table_4_1") if name in frame]
    if (frame["status"] == COMPUTED).all():
        shown.remove("status")
    fields = {
        "comparison": comparison_definition(settings),
        "thesis": THESIS,
        "headline": headline_label(settings),
    }
    notes = [published_note(study.published), regulator_note(settings)]
    notes += [
        f"Could not be computed and is left out: {row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane}: "
        f"{row.basin}: {row.reason}"
        for row in missing.itertuples()
    ]
    return table_from_schema(
        "lifting/stability", "table_4_1", frame, study.source_label, fields, notes=notes, first=tuple(shown)
    )


def _round_to_points(percent: float) -> float:
    """Round a percentage by the thesis's method: the `RESOLUTION` of its areas is a percent."""
    return round(percent, 0) + 0.0  # no negative zero


def _controls_table(
    study: ComparedLifts,
    differences: dict[str, list[dict]],
    areas: pd.DataFrame,
    parts: pd.DataFrame,
) -> Table:
    """Return the controls of the headline: a row per comparison, centre of mass and plane.

    `differences` has the results of `percent_differences` with the same rows: ``headline``, its sections ``initial`` and
    ``minimum``, its null control and every change. `areas` are the headline's, `parts` is the result of `decomposition_table`.
    """
    settings = study.settings
    comparisons = {comparison.name: comparison for comparison in study.comparisons}
    by_key = parts.set_index(["comparison", "com", "plane"])
    shares = (by_key["start_percent"] + by_key["course_percent"]) / by_key["percent"]
    rows = []
    for plane in PLANES:
        for index, row in enumerate(differences["headline"]):
            key = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            values = {name: rows_of[index][plane] for name, rows_of in differences.items()}
            percents = {name: None if np.isnan(value) else value for name, value in values.items()}
            percent, share = percents["headline"], shares.get(tuple(key.values()))
            under_changes = {text: percents[name] for name, text in CHANGES.items() if name in percents}
            spread = [value for value in (percent, *under_changes.values()) if value is not None]
            judgement = row["status"]
            if percent is not None or not judgement.startswith("no basin"):
                here = areas[(areas["com"] == row["com"]) & (areas["plane"] == plane)]
                persons = _compare_subjects(here, comparisons[row["comparison"]])
                judgement = verdict(percent, share, under_changes, persons)
            rows.append(
                {
                    **key,
                    "percent": percent,
                    "movement_share": share,
                    "initial_percent": percents["initial"],
                    "minimum_percent": percents["minimum"],
                    "null_percent": percents[NULL_CONTROL],
                    "thesis_percent": percents["thesis"],
                    "lowest_percent": min(spread, default=None),
                    "highest_percent": max(spread, default=None),
                    "verdict": judgement,
                }
            )
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent") or name == "movement_share"]
    frame = frame.astype(dict.fromkeys(numbers, float))[columns_of("lifting/stability", "table_4_1_controls")]
    fields = {
        "thesis": THESIS,
        "comparison": comparison_definition(settings),
        "headline": headline_label(settings),
    }
    fields |= {"factor": settings.sensitivity_factor, "body": 100 * BODY_MASS_SHARE}
    notes = (regulator_note(settings),)
    return table_from_schema(
        "lifting/stability", "table_4_1_controls", frame, study.source_label, fields, notes=notes
    )


def verdict(
    percent: float | None, movement: float | None, changed: dict[str, float | None], persons: Difference
) -> str:
    """Return whether a percentage survives its controls, with the reasons.

    Parameters
    ----------
    percent : float or None
        Percentage of the headline; None without a value in the study.
    movement : float or None
        Share from the movement (posture at the start and course); None if unknown.
    changed : dict of str to float or None
        Percentage under each change, by its name.
    persons : Difference
        Difference over subjects; its interval is given in percent of the second mean.
    """
    if percent is None:
        return "not testable in this study"
    opposite = [name for name, value in changed.items() if value is not None and value * percent <= 0]
    reasons = [f"its sign turns with {', '.join(opposite)}"] if opposite else []
    if movement is not None and movement < MOVEMENT_SHARE:
        reasons.append(f"{100 * (1 - movement):.0f} % of it come from duration, mass and length")
    unknown = [name for name, value in changed.items() if value is None]
    if movement is None:
        unknown.append("its parts exchanged")
    if unknown:
        reasons.append(f"no basin with {', '.join(unknown)}")
    certainty = persons.remark
    if persons.low is not None and persons.high is not None:
        if persons.low <= 0 <= persons.high:
            reasons.append("its interval over persons contains 0")
        low, high = (100 * end / persons.second for end in (persons.low, persons.high))
        certainty = f"95 % interval over persons [{low:+.2f}, {high:+.2f}] %"
    if reasons:
        return f"does not survive: {'; '.join(reasons)} ({certainty})"
    return f"survives parts and sensitivity ({certainty})"


def _compare_subjects(areas: pd.DataFrame, comparison: BasinComparison) -> Difference:
    """Compare the areas of one percentage over subjects; without an interval, the remark has the reason."""
    if comparison.before is None or comparison.after is None:
        return Difference(np.nan, np.nan, (0, 0), remark="nothing to compare")
    sides = []
    for experience, mass in (comparison.after, comparison.before):
        rows = areas[(areas["experience"] == experience) & (areas["box_mass_kg"] == mass)]
        sides.append(rows.groupby("subject")["mean_area"].mean())
    after, before = comparison.after[0], comparison.before[0]
    return compare_means(*sides, paired=before == after, names=(after, before))


def published_note(published: pd.DataFrame) -> str:
    """Return a note on the agreement of the two published columns, computed from them.

    Parameters
    ----------
    published : pandas.DataFrame
        The thesis's Table 4.1 with a column ``<plane>_percent`` per plane.
    """
    lateral, forward = (published[f"{plane}_percent"].to_numpy(float) for plane in PLANES)
    opposite = int((lateral * forward < 0).sum())
    correlation = np.corrcoef(lateral, forward)[0, 1]
    return (
        f"The published columns correlate {correlation:+.2f} with one another, and {opposite} of {len(lateral)} rows have "
        "opposite signs in the two planes. Mass and duration are the same in both planes and the length nearly so: no effect "
        "of only mass, length and duration makes such columns"
    )


def alternations_table(study: ComparedLifts) -> Table:
    """Return Table 4.1 by the thesis's method after one, two and four alternations; needs the check ``thesis_method``.

    Parameters
    ----------
    study : ComparedLifts
        Lifts of the study and their basins.
    """
    areas = study.areas("thesis", THESIS)
    done = study.settings.thesis_method.alternations
    columns = {f"after_{number}": f"mean_area_after_{number}" for number in EVIDENCE} | {
        "thesis": "mean_area"
    }
    percents = {name: study.percent_differences(areas, column) for name, column in columns.items()}
    percents["exact"] = study.percent_differences(study.areas("exact", THESIS))
    published, rows = study.published_percents, []
    for index, row in enumerate(percents["thesis"]):
        for plane in PLANES:
            entry = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            here = row["comparison"], row["com"]
            entry["published_percent"] = published[f"{plane}_percent"].get(here, np.nan)
            entry["exact_percent"] = float(percents["exact"][index][plane])
            entry |= {f"{name}_percent": _round_to_points(percents[name][index][plane]) for name in columns}
            rows.append(entry)
    frame = pd.DataFrame(rows)
    # Converged, the method would give the same after one alternation or four.
    other = 4 if done < 4 else 1
    change = (frame[f"after_{other}_percent"] - frame["thesis_percent"]).abs().max()
    moves = f"a cell changes by {change:.0f} percentage points, the alternation has not converged"
    moves = moves if change else "no cell changes by a whole point"
    converged = f"{other} alternation{'s' if other > 1 else ''} in place of {done}: {moves}"
    notes = [_jumps_note(areas), _sizes_note(frame, done), converged]
    if len(areas):
        digits = (10.0 ** -decimals(area, RESOLUTION["mean_area"]) / area for area in areas["mean_area"])
        notes.append(
            "Percentages by the thesis's method are in whole points: a solver's tolerance changes its areas by up to "
            f"{100 * RESOLUTION['mean_area']:g} %, and they are rounded (boa.csv) in steps of up to {100 * max(digits):.1f} %"
        )
    return table_from_schema(
        "lifting/stability",
        "table_4_1_alternations",
        frame[columns_of("lifting/stability", "table_4_1_alternations")],
        study.source_label,
        {"comparison": comparison_definition(study.settings), "done": done},
        notes=notes,
    )


def _jumps_note(areas: pd.DataFrame) -> str:
    """Return a note on the basins in which a later alternation than the first changed ρ, and the effect on their areas."""
    moved = areas[areas["jumped_knots"] > 0]
    if moved.empty:
        return f"In none of {len(areas)} basins a further alternation than the first has a multiplier at any knot"
    each = []
    for row in moved.itertuples():
        knots = f"{row.jumped_knots} knots from {row.first_jump:.3f} T to {row.last_jump:.3f} T"
        if row.jumped_knots == 1:
            knots = f"1 knot at {row.first_jump:.3f} T"
        each.append(
            f"{row.subject} {row.box_mass_kg:g} kg, {row.com}, {row.plane.replace('_', ' ')}: {knots}, by up to "
            f"{row.largest_jump:.2g}, mean area {100 * (row.mean_area / row.mean_area_after_1 - 1):+.0f} %"
        )
    return (
        f"In {len(moved)} of {len(areas)} basins some knots have a multiplier again after the first alternation, and ρ grows "
        f"there: {'; '.join(each)}. All others are those of one alternation. The solver of step 1 and the number of knots "
        "decide which they are"
    )


def _sizes_note(frame: pd.DataFrame, done: int) -> str:
    """Return a note on the sizes per plane: as published, after one alternation, and after all alternations."""
    sizes = []
    for plane, rows in frame.groupby("plane", sort=False):
        largest = {
            name: rows[f"{name}_percent"].abs().max() for name in ("published", "exact", "after_1", "thesis")
        }
        sizes.append(
            f"{plane.replace('_', ' ')}: {largest['published']:.1f} % published, {largest['exact']:.1f} exact, "
            f"{largest['after_1']:.0f} after 1 alternation, {largest['thesis']:.0f} after {done}"
        )
    return f"Largest difference, {'; '.join(sizes)}"
