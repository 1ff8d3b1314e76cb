"""Basins of attraction: how fast and how good, in one run beside cvxpy and, where installed, pydrake.

    python benchmarks/stability.py [--starts 10000] [--knots 1000] [--output results/benchmarks/stability.csv]

Takes the pendulums of the default study (`snakemake lifting` makes them). Prints each figure with its target and
writes the table as CSV. Times are CPU time of one core unless stated; they say nothing on a busy machine but ratios.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels, funnel_variants
from lumbar.lifting.stability.funnel.interval_proof import proved_share
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.funnel.saturation import (
    UNSATURATED,
    Saturation,
    disturbance_of,
    reference_of,
    saturated_funnels,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import close_loops
from lumbar.lifting.stability.model.trajectories import trajectories_of_lift
from lumbar.lifting.stability.programme.certified_funnel import certified_funnels
from lumbar.lifting.stability.programme.eqs_4_5_to_4_7_in_cvxpy import RateProgramme
from lumbar.lifting.stability.programme.polynomials import growth_polynomial
from lumbar.lifting.stability.programme.sum_of_squares import CircleProgramme
from lumbar.settings.stability import StabilitySettings

ROWS: list[dict] = []
SIGNS = ("hanging", "inverted")


def report(quantity: str, value: float, target: str, met: bool | None) -> None:
    """Print one figure and keep it for the CSV file."""
    verdict = {True: "met", False: "MISSED", None: ""}[met]
    print(f"{quantity:74s} {value:12.6g}   {target:14s} {verdict}", flush=True)
    ROWS.append({"quantity": quantity, "value": f"{value:.6g}", "target": target, "verdict": verdict})


def study(mass: str = "with_box"):
    """Trajectories and settings of the default study."""
    settings = StabilitySettings()
    folders = sorted((PROJECT / "results" / "thesis" / "lifting").glob("*/pendulum.csv"))
    if not folders:
        sys.exit("no pendulums in results/thesis/lifting: run 'snakemake --cores 2 lifting' first")
    trajectories = [
        trajectory
        for path in folders
        for trajectory in trajectories_of_lift(
            pd.read_csv(path), json.loads(path.with_suffix(".json").read_text(encoding="utf-8")), mass
        )[0]
    ]
    return trajectories, settings


def median_time(job, repeats: int = 5) -> tuple[float, object]:
    """Median CPU time of some runs, and the last result."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = job()
        times.append(time.process_time() - start)
    return float(np.median(times)), result


def checked(part: tuple) -> np.ndarray:
    """Exits of exact and overstated basins of some trajectories (one process of the pool)."""
    trajectories, settings, starts, seed = part
    loops = close_loops(trajectories, settings.pendulum.sign, settings)
    found = funnel_variants(loops, settings.goal_level, negative_control=1.0)
    return np.array(
        [
            monte_carlo_check(loops, found.exact, starts, [seed]).exits,
            monte_carlo_check(loops, found.negative_control, 500, [seed]).exits,
        ]
    )


def exact_method(trajectories, settings, starts: int):
    """Speed, exits, convergence and the interval proof of the exact method."""
    sign, goal = settings.pendulum.sign, settings.goal_level
    seconds, exact = median_time(lambda: exact_funnels(close_loops(trajectories, sign, settings), goal))
    report("exact: 24 BOAs with Riccati equation, one core, s", seconds, "<= 1", seconds <= 1)
    start = time.perf_counter()
    parts = [(trajectories[index::2], settings, starts, index) for index in range(2)]
    with ProcessPoolExecutor(2) as pool:
        exits = np.concatenate(list(pool.map(checked, parts)), axis=1)
    seconds = time.perf_counter() - start
    report(f"exact: 24 BOAs with {starts} starts each, 2 cores, wall s", seconds, "<= 20", seconds <= 20)
    total = int(exits[0].sum())
    report(f"exits in {starts * len(trajectories)} starts at 1e-6", total, "0", total == 0)
    report("fewest exits of a negative control, of 500", exits[1].min(), "> 0", bool(exits[1].min() > 0))
    finer = replace(settings, knots=2 * settings.knots - 1)
    doubled = exact_funnels(close_loops(trajectories, sign, finer), goal)
    change = 100 * float(np.abs(doubled.mean_area / exact.mean_area - 1).max())
    report("largest change of area from N to 2N, %", change, "<= 0.1", change <= 0.1)
    for other in SIGNS:
        loops = close_loops(trajectories, other, settings)
        found = funnel_variants(loops, goal, settings.proof.margin_1_s)
        largest, smaller = found.exact, found.with_margin
        start = time.process_time()
        share = proved_share(loops, smaller)
        seconds = time.process_time() - start
        report(
            f"proved share of the time axis, least, {other}",
            share.min(),
            ">= 0.97",
            bool(share.min() >= 0.97),
        )
        thorax = np.array([item.com == "thorax" for item in trajectories])
        report(f"  of the thorax, {other}", share[thorax].min(), ">= 0.99", bool(share[thorax].min() >= 0.99))
        ratio = (smaller.mean_area / largest.mean_area).min()
        report(f"  at this share of the area, least, {other}", ratio, ">= 0.96", bool(ratio >= 0.96))
        report(f"  CPU s for {len(trajectories)} BOAs, {other}", seconds, "", None)
    return exact


def better_v(trajectories, settings) -> None:
    """Area gained by the best V of the family, attacked."""
    goal, shares = settings.goal_level, settings.lyapunov_shares
    for sign in SIGNS:
        loops = close_loops(trajectories, sign, settings)
        best = best_of_family(loops, goal, shares, negative_control=1.0)
        gained = best.exact.mean_area / exact_funnels(loops, goal).mean_area
        report(f"better V, {sign}: area gained, least (x)", gained.min(), "> 1", bool(gained.min() > 1))
        report(f"better V, {sign}: area gained, most (x)", gained.max(), "", None)
        checked_by_simulation(f"better V, {sign}", best.loops, best)


def checked_by_simulation(name: str, loops, found, saturation: Saturation = UNSATURATED) -> None:
    """Exits of funnels and of the too large ones."""
    starts = 2000
    disturbance = disturbance_of(loops, saturation, starts, [8]) if saturation.active else None
    exits, control = (
        monte_carlo_check(loops, funnels, starts, [9], disturbance).exits
        for funnels in (found.exact, found.negative_control)
    )
    total = int(exits.sum())
    report(f"{name}: exits in {starts * len(exits)} starts", total, "0", total == 0)
    report(f"{name}: fewest exits of a negative control", control.min(), "> 0", bool(control.min() > 0))


def limited_loops(trajectories, settings) -> None:
    """Torque limits and uncertain mass, with and without the box: exact, certified, attacked."""
    saturation = settings.limits
    kinds = {
        "torque": lambda peak: Saturation(torque=1.05 * peak),
        "mass": lambda peak: Saturation(mass_share=saturation.mass_share),
        "both": lambda peak: Saturation(1.05 * peak, saturation.mass_share),
    }
    goal = settings.goal_level
    for (counted, items), sign, kind in product(trajectories.items(), SIGNS, kinds):
        loops = close_loops(items, sign, replace(settings, knots=661))
        chosen = kinds[kind](float(np.abs(reference_of(loops.pendulums).torque).max()))
        name = f"{chosen}, {counted}, {sign}"
        try:
            found = saturated_funnels(loops, goal, chosen, 2.0)
        except NumericalError as error:
            print(f"{name}: no basin: {error}")
            continue
        cost = (found.exact.mean_area / exact_funnels(loops, goal).mean_area).min()
        report(f"{name}: area left, least", cost, "<= 1", bool(cost <= 1 + 1e-9))
        checked_by_simulation(name, loops, found, chosen)
        margin = settings.sum_of_squares.margin_1_s
        funnels, agreement = certified_funnels(loops, goal, 7, 133, margin, chosen)
        ratio = funnels.mean_area / found.exact.mean_area
        worst = float(np.abs(ratio - 1).max())
        report(f"{name}: certified/exact area less 1, largest size", worst, "<= 1e-2", worst <= 1e-2)
        gap = agreement.margin_difference.max()
        report(f"{name}: margins against the arcs' maxima, 1/s", gap, "<= 1e-6", bool(gap <= 1e-6))


def certificates(trajectories, settings, exact, knots: int) -> None:
    """Speed and agreement of the sum-of-squares method."""
    loops = close_loops(trajectories, settings.pendulum.sign, settings)
    options = {"margin": settings.sum_of_squares.margin_1_s}
    for degree, count in ((3, knots), (5, min(knots, 112)), (7, min(knots, 38))):
        try:
            funnels, found = certified_funnels(
                loops, settings.goal_level, degree=degree, knots=count, **options
            )
        except NumericalError as error:
            print(f"sum of squares, Taylor {degree}: no certificates: {error}")
            continue
        ratio = (funnels.mean_area / exact.mean_area).min()
        name = f"sum of squares, Taylor {degree}, {len(funnels.level)} knots"
        report(f"{name}: certified/exact area, least", ratio, ">= 0.9999", bool(ratio >= 0.9999))
        margin = found.margin_difference.max()
        report(f"{name}: margins against exact, 1/s", margin, "<= 1e-6", bool(margin <= 1e-6))
        report(f"{name}: against the true sine, 1/s", found.taylor_difference.max(), "", None)


def programmes(trajectories, settings, exact) -> None:
    """One programme per knot at Taylor 3, against cvxpy and pydrake on the same polynomials."""
    loops = close_loops(trajectories, settings.pendulum.sign, settings)
    chosen = range(0, loops.knots, 37)
    rows = np.concatenate([growth_polynomial(loops.form(2 * k), exact.level[k], 3) for k in chosen])
    programme = CircleProgramme(3)
    ours, rates = median_time(lambda: [programme.rate(row, "benchmark") for row in rows])
    ours *= 1000 / len(rows)
    report("Clarabel by hand: ms per knot", ours, "<= 0.4", ours <= 0.4)
    few = rows[:: max(1, len(rows) // 40)]
    moments = [
        (2 * k, index, exact.level[k, index]) for k in chosen for index in range(len(loops.pendulums.labels))
    ]
    written = RateProgramme(3)
    slow, reference = median_time(
        lambda: [written.solve(loops, *moment) for moment in moments[:: max(1, len(rows) // 40)]], 1
    )
    slow *= 1000 / len(few)
    report("Eq. 4.6 in cvxpy: ms per knot", slow, "", None)
    report("  times slower", slow / ours, ">= 15", slow / ours >= 15)
    difference = np.abs(np.array(rates)[:: max(1, len(rows) // 40)] - reference).max()
    report("  largest difference of rates, 1/s", difference, "<= 1e-5", bool(difference <= 1e-5))
    try:
        from drake_reference import drake_rate
    except ImportError:
        print("pydrake is not installed here: no comparison")
        return
    slow, reference = median_time(lambda: [drake_rate(row) for row in few], 2)
    slow *= 1000 / len(few)
    report("pydrake (Clarabel): ms per knot", slow, "", None)
    report("  times slower", slow / ours, ">= 3", slow / ours >= 3)
    difference = np.abs(np.array(rates)[:: max(1, len(rows) // 40)] - reference).max()
    report("  largest difference of rates, 1/s", difference, "<= 1e-5", bool(difference <= 1e-5))


def main() -> None:
    """Run everything, print it, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=10_000)
    parser.add_argument("--knots", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=PROJECT / "results" / "benchmarks" / "stability.csv")
    options = parser.parse_args()
    trajectories, settings = study()
    exact = exact_method(trajectories, settings, options.starts)
    programmes(trajectories, settings, exact)
    better_v(trajectories, settings)
    boxes = {"with box": trajectories, "without box": study("without_box")[0]}
    limited_loops({name: items[2:4] for name, items in boxes.items()}, settings)
    certificates(trajectories, settings, exact, options.knots)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with options.output.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, ["quantity", "value", "target", "verdict"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(ROWS)
    print(f"written: {options.output}")


if __name__ == "__main__":
    main()
