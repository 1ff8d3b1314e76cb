"""Statistics of people: does a 5 % test reject in 5 %, does a 95 % interval cover in 95 %, is the power as computed?

    python benchmarks/population.py [--runs 1000] [--output results/benchmarks/population.csv]

Simulates groups of people with known scatter between people and trials, runs the library's own functions on them, prints
a table with the share of runs in which 0 lies outside of the interval although there is no difference, and writes it
as CSV. The target is 3 to 7 %. Rows named "for comparison" are what is not used, and why.
"""

from __future__ import annotations

import argparse
import sys
from itertools import product
from pathlib import Path

import one_thread  # noqa: F401 # isort: skip

import numpy as np
import pandas as pd

from lumbar.lifting.population.contrast import between_groups, within_persons
from lumbar.lifting.population.sample_size import person_mean_sd, persons_needed, power
from lumbar.lifting.population.variance_components import variance_components
from lumbar.lifting.pushes.chances import told_by_others
from lumbar.lifting.pushes.prediction import increment_of
from lumbar.lifting.pushes.roc import (
    area,
    area_interval,
    areas,
    groups_of,
    left_out,
    sort_scores,
)
from lumbar.settings.pushes import ScoringSettings
from simulated_people import UNEQUAL, draw_group, draw_pair

TARGET = 0.03, 0.07
MEAN = 10.0
"""Of a group where percentages are tested; the standard deviation of single trials is 1."""


def mixed_model(first, second, **options):
    """What a study's table computes; with equal numbers of trials the ratio of variances changes nothing."""
    equal = len({*first.trials, *second.trials}) == 1
    ratio = None if equal else variance_components([first, second]).variance_ratio
    return between_groups(first, second, ratio, **options)


def excluded(interval, value=0.0) -> bool:
    """Whether an interval leaves the truth out; where a percentage has none, it may be anything."""
    return interval.is_known and not interval.low <= value <= interval.high


def group_test(rng, persons, trials, correlation, options, runs) -> dict[str, float]:
    """Shares of runs in which the truth lies outside of the interval, by kind of interval."""
    first_trials, second_trials = trials if isinstance(trials, tuple) else (trials, trials)
    first_persons, second_persons = persons if isinstance(persons, tuple) else (persons, persons)
    scale, skewed = options.get("scale", 1.0), options.get("skewed", False)
    outside = {"difference": 0, "percent": 0}
    for _ in range(runs):
        first = draw_group(rng, first_persons, first_trials, correlation, MEAN, scale, skewed)
        second = draw_group(rng, second_persons, second_trials, correlation, MEAN, 1.0, skewed)
        contrast = mixed_model(first, second)
        outside["difference"] += excluded(contrast.interval)
        outside["percent"] += excluded(contrast.percent_interval)
    return {name: count / runs for name, count in outside.items()}


def pair_test(rng, persons, trials, correlation, runs) -> dict[str, float]:
    """Return the same for two conditions of the same persons, the second with a mean twice as large."""
    outside = {"difference": 0, "percent": 0}
    for _ in range(runs):
        first, second = draw_pair(rng, persons, trials, correlation, (2 * MEAN, MEAN))
        contrast = within_persons(first, second)
        outside["difference"] += excluded(contrast.interval, MEAN)
        outside["percent"] += excluded(contrast.percent_interval, 100.0)
    return {name: count / runs for name, count in outside.items()}


def pooled_percentiles(rng, persons, trials, correlation, runs, kind) -> float:
    """Share of false alarms of percentile bootstraps: over pooled trials, over persons, over persons and trials."""
    outside = 0
    for _ in range(runs):
        means = []
        for _ in range(2):
            values = np.stack(draw_group(rng, persons, trials, correlation).values)
            if kind == "trials":
                drawn = rng.choice(values.ravel(), (500, values.size)).mean(axis=1)
            else:
                who = rng.integers(0, persons, (500, persons, 1))
                which = (
                    np.arange(trials)
                    if kind == "persons"
                    else rng.integers(0, trials, (500, persons, trials))
                )
                drawn = values[who, which].mean(axis=(1, 2))
            means.append(drawn)
        low, high = np.quantile(means[0] - means[1], [0.025, 0.975])
        outside += not low <= 0 <= high
    return outside / runs


def wald(rng, persons, trials, correlation, runs) -> float:
    """Share of false alarms of the mixed model's own p value, which takes z for t."""
    import warnings

    from statsmodels.regression.mixed_linear_model import MixedLM

    outside = 0
    for _ in range(runs):
        groups = [draw_group(rng, persons, trials, correlation) for _ in range(2)]
        values = np.concatenate([found for group in groups for found in group.values])
        labels = np.repeat(np.arange(2 * persons), [len(found) for group in groups for found in group.values])
        design = np.column_stack([np.ones(len(values)), labels < persons])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            outside += MixedLM(values, design, groups=labels).fit().pvalues[1] < 0.05
    return outside / runs


def power_test(rng, difference, person_sd, trial_sd, trials, paired, runs) -> tuple[int, float, float]:
    """Persons needed for a power of 80 %, the power computed, and that of simulated studies of this size."""
    total = np.hypot(person_sd, trial_sd)
    correlation = (person_sd / total) ** 2
    sd = person_mean_sd(person_sd, trial_sd, trials) * (np.sqrt(2) if paired else 1)
    persons = persons_needed(difference, sd, paired=paired)
    found = 0
    for _ in range(runs):
        if paired:
            contrast = within_persons(
                *draw_pair(rng, persons, trials, correlation, (difference / total, 0.0))
            )
        else:
            first, second = (
                draw_group(rng, persons, trials, correlation, mean) for mean in (difference / total, 0.0)
            )
            contrast = between_groups(first, second)
        found += contrast.p_value < 0.05
    return persons, power(difference, sd, persons, paired=paired), found / runs


def pushed(rng, persons, spread, steepness, own) -> tuple[np.ndarray, ...]:
    """Scores, steps and persons of 24 pushes each: scores scatter by `spread` between persons, thresholds by `own`."""
    person = np.repeat(np.arange(persons), 24)
    score = rng.normal(size=person.size) + rng.normal(0, spread, persons)[person]
    odds = steepness * score + rng.normal(0, own, persons)[person]
    return score, rng.random(person.size) < 1 / (1 + np.exp(-odds)), person


def area_intervals(rng, persons, kind, true, runs) -> dict[str, float]:
    """Share of intervals of an area under the ROC that leave the true one out."""
    outside = {"area, jackknife": 0, "area, percentiles": 0}
    for _ in range(runs):
        scores, whole = sort_scores(*pushed(rng, persons, *kind)), np.ones((1, persons))
        interval = area_interval(areas(scores, whole)[0], areas(scores, left_out(persons)))
        drawn = areas(scores, rng.multinomial(persons, np.full(persons, 1 / persons), 400))
        low, high = np.nanpercentile(drawn, [2.5, 97.5])
        outside["area, jackknife"] += interval is None or not interval[0] <= true <= interval[1]
        outside["area, percentiles"] += not low <= true <= high
    return {name: count / runs for name, count in outside.items()}


def increment_of_pushes(rng, persons, adds) -> tuple[np.ndarray, ...]:
    """Chances with and without a measure that `adds` so much, learnt on others, of 24 pushes each; steps and persons."""
    size, _, person = pushed(rng, persons, 0.0, 1.0, 0.0)
    measure, way = rng.normal(size=person.size), np.tile(["forward", "backward"], len(person) // 2)
    odds = 2.5 * size + adds * measure + rng.normal(0, 0.7, persons)[person]
    steps = rng.random(person.size) < 1 / (1 + np.exp(-odds))
    told = told_by_others(
        {"known": [size], "added": [size, measure]}, steps, way, groups_of(person, 5, [persons, 4])
    )
    return told["added"], told["known"], steps, person


def increment_intervals(rng, persons, adds, runs) -> dict[str, float]:
    """Shares of intervals of an increment of area that lie above and below the true one."""
    added, known, steps, _ = increment_of_pushes(rng, 5000, adds)
    true, above, below = area(added, steps) - area(known, steps), 0, 0
    for _ in range(runs):
        found = increment_of(*increment_of_pushes(rng, persons, adds), ScoringSettings())
        above += found["increment_low"] > true
        below += found["increment_high"] < true
    return {f"increment of {true:.3f}, above": above / runs, f"increment of {true:.3f}, below": below / runs}


def calibration(runs: int) -> pd.DataFrame:
    """Return all rows of the table."""
    rng, rows = np.random.default_rng(20), []

    def add(what, persons, trials, correlation, shares, used=True):
        for interval, share in shares.items():
            low, high = TARGET
            inside = ("yes" if low <= share <= high else "NO") if used else "not used"
            rows.append(
                dict(zip(COLUMNS, (what, persons, trials, correlation, interval, share, inside), strict=True))
            )
            print(*(f"{value!s:<24}" for value in rows[-1].values()), flush=True)

    plans = product((3, 5, 10, 20), (1, 3, 5, UNEQUAL, (1, 5)), (0.2, 0.8))
    for persons, trials, correlation in plans:
        add("groups", persons, trials, correlation, group_test(rng, persons, trials, correlation, {}, runs))
    for persons, trials, correlation in product((3, 5, 10, 20), (1, 3, UNEQUAL), (0.2, 0.8)):
        add("same persons", persons, trials, correlation, pair_test(rng, persons, trials, correlation, runs))
    for persons in ((3, 10), (5, 15), (15, 5)):
        for scale in (1.0, 2.0):
            options = {"scale": scale}
            add(
                f"sizes differ, SD {scale:g} to 1",
                persons,
                3,
                0.5,
                group_test(rng, persons, 3, 0.5, options, runs),
            )
    for persons in (5, 10, 20):
        add("SD 2 to 1", persons, 3, 0.5, group_test(rng, persons, 3, 0.5, {"scale": 2.0}, runs))
        add("skewed people", persons, 3, 0.8, group_test(rng, persons, 3, 0.8, {"skewed": True}, runs))
    for persons, correlation in product((3, 10), (0.2, 0.8)):
        shares = {
            f"percentiles over {kind}": pooled_percentiles(rng, persons, 3, correlation, runs, kind)
            for kind in ("trials", "persons", "persons and trials")
        }
        shares["MixedLM's own p (z)"] = wald(rng, persons, 3, correlation, max(runs // 5, 1))
        add("for comparison", persons, 3, correlation, shares, used=False)
    for kind in ((0.5, 1.5, 0.7), (0.3, 6.0, 2.0), (1.0, 4.0, 0.5)):
        everybody = sort_scores(*pushed(rng, 20000, *kind))
        true = float(areas(everybody, np.ones((1, 20000)))[0])
        for persons in (6, 8, 10, 20):
            shares = area_intervals(rng, persons, kind, true, runs)
            for name, used in (("area, jackknife", True), ("area, percentiles", False)):
                add(f"who steps, area {true:.3f}", persons, 24, "", {name: shares[name]}, used)
    for adds, persons in product((0.0, 1.5), (8, 12, 20)):
        shares = increment_intervals(rng, persons, adds, runs // 4)
        add("who steps, a measure added", persons, 24, "", shares, used=False)
    return pd.DataFrame(rows)


def power_table(runs: int) -> pd.DataFrame:
    """Return power as computed and as simulated."""
    rng, rows = np.random.default_rng(21), []
    for difference, person_sd, trial_sd, trials, paired in (
        *((1.0, 0.8, 0.6, 1, False), (1.0, 0.8, 0.6, 5, False), (0.5, 0.3, 1.0, 3, False)),
        *((1.0, 0.8, 0.6, 1, True), (1.0, 0.8, 0.6, 3, True), (2.0, 0.5, 0.5, 3, True)),
    ):
        found = power_test(rng, difference, person_sd, trial_sd, trials, paired, runs)
        rows.append((difference, person_sd, trial_sd, trials, paired, *found))
    columns = ["difference", "person_sd", "trial_sd", "trials", "paired", "persons", "power", "simulated"]
    return pd.DataFrame(rows, columns=columns)


COLUMNS = ("what", "persons", "trials", "intraclass correlation", "interval", "truth outside", "3 to 7 %")


def main() -> int:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=Path("results/benchmarks/population.csv"))
    arguments = parser.parse_args()
    table = calibration(arguments.runs)
    powers = power_table(arguments.runs)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.output, index=False)
    powers.to_csv(arguments.output.with_name(f"{arguments.output.stem}_power.csv"), index=False)
    print(powers.to_string(index=False))
    used = table[table["3 to 7 %"] != "not used"]
    print(f"{(used['3 to 7 %'] == 'yes').sum()} of {len(used)} rows within 3 to 7 %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
