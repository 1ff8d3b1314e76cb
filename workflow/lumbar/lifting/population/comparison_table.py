"""Comparisons of people as published tables: what differs, and how large a study has to be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.population.comparison import Comparison
from lumbar.lifting.population.sample_size import (
    assured_sd,
    detectable_difference,
    persons_needed,
    sd_interval,
)
from lumbar.lifting.population.variance_components import FEWEST_PERSONS
from lumbar.tables.table import Table

if TYPE_CHECKING:
    from lumbar.settings.population import PopulationSettings

_KEYS = {
    "comparison": "A_vs_B: group A less group B at the same box, of different persons; decrease_in_mass_…: the lightest box "
    "less the heaviest, within the persons of a group who lifted both",
    "box_mass_kg": "mass of the box in kg",
    "measure": "what is compared",
    "plane": "plane of the measure",
}
_COMPARISON = {
    **_KEYS,
    "unit": "unit of the following four",
    "first": "mean over persons of the first side (group A, the lightest box)",
    "second": "mean over persons of the second side",
    "difference": "first − second: fixed effect of a mixed-effects model with person as the random effect (REML)",
    "low": "lower end of its 95 % interval: t on the persons' means, weighted 1/(σ_person² + σ_trial²/trials)",
    "high": "upper end",
    "df": "degrees of freedom: persons − 2 with groups of equal size, otherwise Satterthwaite's with a scatter for each; "
    "persons − 1 within persons",
    "p": "two-sided p value of no difference",
    "p_holm": "the same adjusted after Holm over all measures and planes of this comparison and box (the note says how many)",
    "percent": "100(first − second)/second, where the second mean is positive",
    "percent_low": "lower end of its 95 % interval (Fieller)",
    "percent_high": "upper end",
    "bootstrap_low": "lower end of the difference's 95 % interval by cluster bootstrap (whole persons, studentised)",
    "bootstrap_high": "upper end",
    "safer": "the side whose values are the safer ones, where the interval leaves 0 out",
    "persons": "persons on either side",
    "trials": "trials on either side",
    "remark": "what is missing and why",
}
_PLANNING = {
    **_KEYS,
    "unit": "unit of the following four",
    "person_sd": "standard deviation between people of a group or, within persons, between their changes",
    "trial_sd": "standard deviation between the trials of one person with one box",
    "person_mean_sd": "standard deviation of the persons' means (changes) with the trials that they have here",
    "sought": "difference that a study to be planned shall see",
    "intraclass_correlation": "σ_person²/(σ_person² + σ_trial²): 1 where all trials of a person are alike",
    "detectable": "smallest difference that a study of this size sees",
    "remark": "why there is no number",
}


def comparison_table(comparisons: Sequence[Comparison], data: str) -> Table:
    """Return what differs between groups and boxes."""
    import pandas as pd

    frame = pd.DataFrame([_row(item) for item in comparisons], columns=list(_COMPARISON))
    numbers = frame.columns[frame.columns.get_loc("low") : frame.columns.get_loc("safer")]
    frame = frame.astype(dict.fromkeys(numbers, float))
    families = frame.groupby(["comparison", "box_mass_kg"], sort=False)["p"]
    adjusted, sizes = families.transform(_holm), sorted(set(families.count()))
    return Table(
        title="What differs between groups of people and between their boxes.",
        frame=frame.assign(p_holm=adjusted),
        definitions=_COMPARISON,
        data=data,
        notes=(
            f"No interval rests on fewer than {FEWEST_PERSONS} persons of a group. Trials of one person are no people: they "
            "make the person's mean more certain and nothing else",
            f"Holm's adjustment is made within families of {' or '.join(map(str, sizes))} tests, one family for each comparison "
            "and box; over several families together chance has more to choose from",
        ),
        decimals={"df": 1, "p": 4, "p_holm": 4}
        | dict.fromkeys(("percent", "percent_low", "percent_high"), 1),
        may_be_empty=frozenset(numbers),
    )


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
    import pandas as pd

    measures = sorted({item.measure for item in comparisons})
    unknown = sorted(set(settings.detect) - set(measures))
    if unknown:
        raise InputError(
            f"population.detect: no measure {', '.join(unknown)}; measures: {', '.join(measures)}"
        )
    needed = {
        f"persons_with_{count}_trial{'' if count == 1 else 's'}": count for count in settings.planned_trials
    }
    text = (
        f"persons (of each group; altogether within persons) with {{}} trials each, at each box, that see the difference "
        f"sought with a power of {settings.power:g} at the level {settings.significance:g} (noncentral t on person means), were "
        "the standard deviation known"
    )
    further = {
        "_low": "the same with the standard deviation's lower 95 % limit",
        "_high": "with its upper one",
        "_assured": f"with what it stays below with a probability of {settings.assurance:g}: the size to plan with",
    }
    texts = {
        name + end: said
        for name, count in needed.items()
        for end, said in {"": text.format(count), **further}.items()
    }
    columns = [*list(_PLANNING)[:-1], *texts, "remark"]
    frame = pd.DataFrame([_planning_row(item, settings, needed) for item in comparisons], columns=columns)
    numbers = frozenset(columns[columns.index("person_sd") : -1])
    # Counts with empty cells: as objects they print as whole numbers.
    frame = frame.astype(dict.fromkeys(numbers - set(texts), float) | dict.fromkeys(texts, object))
    return Table(
        title="How many people, with how many trials each, a study needs to see a difference.",
        frame=frame,
        definitions=_PLANNING | texts,
        data=data,
        notes=(
            "Standard deviations estimated from few persons are themselves uncertain, and with them the numbers needed: planned "
            "with the standard deviation as found, fewer than half of all studies have the power wanted. "
            "Uncertainty of the sought difference, where it is a share of a mean, is left out",
        ),
        may_be_empty=numbers,
    )


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
