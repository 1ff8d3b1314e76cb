"""Whether the diagnosis' probabilities and intervals are what they say, on simulated tissue tests whose truth is known.

    python benchmarks/calibration.py [--count 17] [--markdown docs/tissue/acceptance.md]

Linear tissues under noise and sensor faults: the p-value of the best effect that is not there, and whether one is named.
Tissues with one effect, fitted in its own form: whether the 95 % intervals hold the true values. Writes every single result to
``results/benchmark/calibration_{nulls,intervals}.csv``; with ``--markdown`` a table into that page,
and the picture into ``docs/images``.
``--count`` is the number of experiments per effect and colour of the noise; of nulls there are 0.7 times as many per condition.
"""

from __future__ import annotations

import argparse
import sys
from itertools import product
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from acceptance_page import show_section
from calibration_records import (
    COLOURS,
    CONDITIONS,
    KNOWN,
    LINEAR_TISSUES,
    TRUE_NAMES,
    KnownEffect,
    effect_experiment,
    null_records,
    single_form_catalogue,
)
from calibration_tables import coverage, coverage_lines, null_lines
from lumbar.base.errors import LumbarError
from lumbar.base.files import write_csv
from lumbar.base.progress import track
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.candidate import likelihood_ratio
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.forward_selection import extend
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refine
from lumbar.tissue.diagnosis.selection.thresholds import null_distribution
from lumbar.tissue.effects.catalogue import TISSUE as CATALOGUE
from lumbar.tissue.models.model_data import FittedParameter

RESULTS = Path("results/benchmark")
NULLS = 0.7
"""Nulls per condition, for each experiment per effect and colour: a diagnosis takes ten times as long as a fit."""


def null_row(condition: str, number: int) -> dict:
    """Diagnose a tissue with nothing hidden.

    ``p_value`` is that of the candidate, in all its forms, that gains most; ``p_shown`` the smallest that the ranking shows of
    a single effect, each in the form that its number of parameters is worth.
    """
    tissue = LINEAR_TISSUES[number % len(LINEAR_TISSUES)]
    verdict = diagnose(null_records(condition, tissue, number))
    false = {name: item for name, item in CATALOGUE.items() if name not in TRUE_NAMES.get(condition, ())}
    candidates = extend(verdict.base, false, verdict.experiment)
    ratio = max(likelihood_ratio(verdict.base, item, verdict.experiment) for item in candidates)
    shown = [item for item in verdict.ranking if len(item.candidate.effects) == 1]
    named = [name for name in verdict.selected if name in false and verdict.status in ("named", "tied")]
    return {
        "condition": condition,
        "tissue": tissue,
        "number": number,
        "base": verdict.base.fit.structure.base.name,
        "verdict": verdict.status,
        "named": "+".join(named),
        "findings": "+".join(sorted({item.kind for item in verdict.findings})),
        "p_value": null_distribution().p_value(ratio, sum(len(item.forms) for item in CATALOGUE.values())),
        "p_shown": min((item.p_value for item in shown if item.candidate.effects[0] in false), default=1.0),
    }


def interval_rows(known: KnownEffect, colour: str, number: int) -> list[dict]:
    """Fit base and effect, and compare every interval with the truth; one row without a parameter where the fit is refused."""
    experiment = effect_experiment(known, colour, number)
    settings = DiagnosisSettings(base="KB", catalogue=single_form_catalogue(known))
    parameters = {"effect": known.effect, "noise": colour, "number": number}
    try:
        prepared, path = refine(experiment.records, [known.effect], settings)
        estimated = fitted_model(path[-1], prepared).parameters
    except LumbarError as error:
        return [{**parameters, "refused": str(error)}]
    fitted = [item for item in estimated if not item.derived]
    truth = order_branches(experiment.truth, fitted)
    return [
        {
            **parameters,
            "owner": item.effect,
            "parameter": item.name,
            "true": truth[item.effect, item.name],
            "value": item.value,
            "low": item.low,
            "high": item.high,
            "refused": "",
        }
        for item in fitted
    ]


def order_branches(
    truth: dict[tuple[str, str], float], fitted: list[FittedParameter]
) -> dict[tuple[str, str], float]:
    """Return the true values, with the two Maxwell branches exchanged if the base became the slower one.

    Nothing determines which of the two branches is that of the base.
    """
    values = {(item.effect, item.name): item.value for item in fitted}
    own, other = ("", "relaxation_time"), ("second_relaxation", "relaxation_time")
    if other not in values or values[own] < values[other]:
        return truth
    exchanged = {
        ("second_relaxation" if not owner else "", name): value for (owner, name), value in truth.items()
    }
    return {**truth, **{key: value for key, value in exchanged.items() if key in truth}}


def measured(nulls: int, effects: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows of all nulls, and of all intervals."""
    plans = list(product(CONDITIONS, range(nulls)))
    tissues = pd.DataFrame([null_row(*plan) for plan in track(plans, "nulls")])
    plans = list(product(KNOWN, COLOURS, range(effects)))
    rows = [row for plan in track(plans, "known effects") for row in interval_rows(*plan)]
    return tissues, pd.DataFrame(rows)


def report(nulls: pd.DataFrame, intervals: pd.DataFrame, page: Path | None) -> None:
    """Print the tables; with a page, write them into it."""
    covered = coverage(intervals)
    refused = intervals["parameter"].isna().sum()
    experiments = len(intervals.drop_duplicates(["effect", "noise", "number"]))
    lines = [
        f"{len(nulls)} experiments with nothing hidden, and {experiments} with one effect, of which {refused} fits were refused. "
        "In brackets Wilson's 95 % intervals.",
        "",
        *null_lines(nulls),
        "",
        *coverage_lines(covered),
    ]
    show_section(page, "calibration", lines)


def main() -> None:
    """Measure, and write what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=17)
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    nulls, intervals = measured(max(1, round(NULLS * options.count)), options.count)
    RESULTS.mkdir(parents=True, exist_ok=True)
    write_csv(RESULTS / "calibration_nulls.csv", nulls)
    write_csv(RESULTS / "calibration_intervals.csv", intervals)
    report(nulls, intervals, options.markdown)


if __name__ == "__main__":
    main()
