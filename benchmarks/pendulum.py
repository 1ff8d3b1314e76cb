"""Accuracy of the diagnosis of pendulums: experiments by Newton's law with one hidden effect, or none, diagnosed blind.

    python benchmarks/pendulum.py --seeds 20

Prints how many are named right by effect, by what is measured, and by strength (RMS that the best pendulum leaves of the
training record, over the noise), with 95 % intervals (Wilson); writes one row per experiment to
``results/benchmark/pendulum.csv``.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.files import write_csv
from lumbar.base.progress import track
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from pendulum_experiments import EFFECTS, make_pendulum_experiment, records_of

MEASURABLE = ("hand_load", "variable_length", "moving_pivot")
"""Effects of which further columns can be recorded."""
FIRST_SEED = 1000
"""Away from the seeds of the tests."""


def plans(seeds: int, strengths: list[float]) -> list[tuple]:
    """Effect, seed, strength, whether further columns are recorded, whether the training record repeats."""
    rows = []
    for effect, columns, periodic in product(EFFECTS, (True, False), (True, False)):
        if columns or effect in MEASURABLE:
            numbers = range(FIRST_SEED, FIRST_SEED + seeds)
            rows += [(effect, seed, value, columns, periodic) for seed in numbers for value in strengths]
    nulls = range(FIRST_SEED, FIRST_SEED + 5 * seeds)
    return rows + [("", seed, 0.0, True, periodic) for seed in nulls for periodic in (True, False)]


def examine(plan: tuple) -> dict:
    """Make one experiment, diagnose it, and only then look at its label."""
    experiment = make_pendulum_experiment(*plan)
    diagnosis = diagnose(records_of(experiment.records), DiagnosisSettings(base="pendulum"))
    effect, seed, strength, columns, periodic = plan
    wanted = ("named", (effect,)) if effect else ("adequate", ())
    return {
        "effect": effect or "none",
        "variant": experiment.variant,
        "seed": seed,
        "strength": strength,
        "columns": columns,
        "periodic": periodic,
        "verdict": diagnosis.status,
        "selected": "+".join(diagnosis.selected),
        "right": (diagnosis.status, diagnosis.selected) == wanted,
        "error_over_noise": diagnosis.model.test_rms / experiment.noise_rms,
    }


def wilson(right: int, number: int) -> str:
    """Share with its 95 % interval."""
    square = 1.96**2
    middle = (right + square / 2) / (number + square)
    half = 1.96 * np.sqrt(right * (number - right) / number + square / 4) / (number + square)
    return f"{right} of {number} ({100 * (middle - half):.1f} to {100 * (middle + half):.1f} %)"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--strengths", type=float, nargs="+", default=[3.0, 4.0, 8.0, 16.0])
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("results/benchmark/pendulum.csv"))
    options = parser.parse_args()
    todo = plans(options.seeds, options.strengths)
    with ProcessPoolExecutor(options.cores) as pool:
        rows = [pool.submit(examine, plan) for plan in todo]
        table = pd.DataFrame([row.result() for row in track(rows, "pendulums")])
    write_csv(options.output, table)
    nothing = table["effect"] == "none"
    groups = [("effect", "columns", "periodic"), ("strength",)]
    for keys in groups:
        for key, part in table[~nothing].groupby(list(keys)):
            named = ", ".join(f"{name} {value}" for name, value in zip(keys, key, strict=True))
            print(f"{named}: {wilson(int(part['right'].sum()), len(part))} named")
    accused = table[nothing & (table["selected"] != "")]
    print(f"nothing hidden: {wilson(len(accused), int(nothing.sum()))} accused of an effect")
    print(f"nothing hidden: {wilson(int(table[nothing]['right'].sum()), int(nothing.sum()))} adequate")
    right = table[~nothing & table["right"]]
    print(
        f"error over noise, named: {right['error_over_noise'].quantile([0.5, 0.95, 1.0]).round(3).to_list()}"
    )


if __name__ == "__main__":
    main()
