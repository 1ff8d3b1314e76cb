"""Basins of attraction: how fast and how accurate the exact method and the best V of the family are.

    python benchmarks/stability.py [--starts 10000] [--output results/benchmarks/stability.csv]

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
from pathlib import Path

from one_thread import PROJECT  # isort: skip

import numpy as np
import pandas as pd

from lumbar.lifting.stability.funnel.exact_funnel import best_of_family, exact_funnels, funnel_variants
from lumbar.lifting.stability.funnel.interval_proof import proved_share
from lumbar.lifting.stability.funnel.monte_carlo_check import monte_carlo_check
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import trajectories_of_lift
from lumbar.settings.lifting import StabilitySettings

ROWS: list[dict] = []
SIGNS = ("hanging", "inverted")


def report(quantity: str, value: float, target: str, met: bool | None) -> None:
    """Print one figure and keep it for the CSV file."""
    verdict = {True: "met", False: "MISSED", None: ""}[met]
    print(f"{quantity:74s} {value:12.6g}   {target:14s} {verdict}", flush=True)
    ROWS.append({"quantity": quantity, "value": f"{value:.6g}", "target": target, "verdict": verdict})


def study():
    """Return the trajectories and the settings of the default study."""
    settings = StabilitySettings()
    folders = sorted((PROJECT / "results" / "thesis" / "lifting").glob("*/pendulum.csv"))
    if not folders:
        sys.exit("no pendulums in results/thesis/lifting: run 'snakemake --cores 2 lifting' first")
    trajectories = [
        trajectory
        for path in folders
        for trajectory in trajectories_of_lift(
            pd.read_csv(path), json.loads(path.with_suffix(".json").read_text(encoding="utf-8")), "with_box"
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
    funnels = funnel_variants(loops, settings.goal_level, negative_control=1.0)
    return np.array(
        [
            monte_carlo_check(loops, funnels.exact, starts, [seed]).exits,
            monte_carlo_check(loops, funnels.negative_control, 500, [seed]).exits,
        ]
    )


def exact_method(trajectories, settings, starts: int) -> None:
    """Print speed, exits, convergence and the interval proof of the exact method."""
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
    finer = settings.model_copy(update={"knots": 2 * settings.knots - 1})
    doubled = exact_funnels(close_loops(trajectories, sign, finer), goal)
    change = 100 * float(np.abs(doubled.mean_area / exact.mean_area - 1).max())
    report("largest change of area from N to 2N, %", change, "<= 0.1", change <= 0.1)
    for other in SIGNS:
        loops = close_loops(trajectories, other, settings)
        variants = funnel_variants(loops, goal, settings.proof.margin_1_s)
        largest, smaller = variants.exact, variants.with_margin
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


def better_v(trajectories, settings) -> None:
    """Report the area gained by the best V of the family."""
    goal, shares = settings.goal_level, settings.lyapunov_shares
    for sign in SIGNS:
        loops = close_loops(trajectories, sign, settings)
        best = best_of_family(loops, goal, shares)
        gained = best.mean_area / exact_funnels(loops, goal).mean_area
        report(f"better V, {sign}: area gained, least (x)", gained.min(), "> 1", bool(gained.min() > 1))
        report(f"better V, {sign}: area gained, most (x)", gained.max(), "", None)


def main() -> None:
    """Run everything, print it, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=10_000)
    parser.add_argument("--output", type=Path, default=PROJECT / "results" / "benchmarks" / "stability.csv")
    options = parser.parse_args()
    trajectories, settings = study()
    exact_method(trajectories, settings, options.starts)
    better_v(trajectories, settings)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with options.output.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, ["quantity", "value", "target", "verdict"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(ROWS)
    print(f"written: {options.output}")


if __name__ == "__main__":
    main()
