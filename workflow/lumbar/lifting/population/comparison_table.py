"""Comparisons of people as published tables: what differs, and how large a study has to be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.population.comparison import Comparison
from lumbar.lifting.population.sample_size import (
    assured_sd,
    detectable_difference,
    persons_needed,
    sd_interval,
)
from lumbar.lifting.population.variance_components import FEWEST_PERSONS
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

if TYPE_CHECKING:
    from lumbar.settings.population import PopulationSettings


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
        "first": contrast.first,
        "second": contrast.second,
        "difference": contrast.difference,
        "low": contrast.interval.low,
        "high": contrast.interval.high,
        "df": contrast.freedom if known else None,
        "p": contrast.p_value,
        "percent": contrast.percent,
        "percent_low": contrast.percent_interval.low,
        "percent_high": contrast.percent_interval.high,
        "bootstrap_low": item.bootstrap.low,
        "bootstrap_high": item.bootstrap.high,
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
