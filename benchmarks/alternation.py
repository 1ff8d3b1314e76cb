"""The thesis's alternation (Eqs 4.5–4.7) under other solvers, tolerances and knots: what Table 4.1 owes to them.

    python benchmarks/alternation.py [--knots 1000] [--output results/benchmarks/alternation.csv]

Takes the pendulums of the default study in the thesis's wording (`snakemake lifting` makes them). Every row is one way to solve
the same problem; its cells are ranges over the 18 cells of Table 4.1 and counts over all basins.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.base.files import read_json, write_csv
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_alternation import (
    ACCURACY,
    DEGREE,
    Alternation,
    alternate,
)
from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_in_cvxpy import (
    Polynomial,
    constant,
    s_procedure,
    unknown,
)
from lumbar.lifting.stability.funnel.sum_of_squares import Certificate, monomials
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops, close_loops
from lumbar.lifting.stability.model.pendulum_trajectories import PLANES, THESIS, LiftStates, Trajectory
from lumbar.lifting.stability.percent_differences import comparisons_of, percent_differences
from lumbar.settings.lifting import StabilitySettings

PROJECT = Path(__file__).resolve().parents[1]
ALTERNATIONS = 4
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


class Written:
    """Step 1 written with cvxpy for any of its solvers; it replaces `Certificate`."""

    def __init__(self, solver: str, **options):
        import cvxpy as cp

        self._solver, self._options = solver, options
        self._growth = unknown(monomials(DEGREE + 1), cp.Parameter)
        self._multiplier = unknown(monomials(DEGREE - 1), cp.Variable)
        self._rate = cp.Variable()
        ring = Polynomial({(0, 0): 1.0, (2, 0): -1.0, (0, 2): -1.0})
        constraints = s_procedure(constant(self._rate) - self._growth, ring, self._multiplier)
        self._problem = cp.Problem(cp.Minimize(self._rate), constraints)

    def solve(self, coefficients: np.ndarray, label: str) -> tuple[float, np.ndarray]:
        """Return the smallest rate and the coefficients of L, as `Certificate.solve` does."""
        scale = float(np.abs(coefficients).max())
        for parameter, value in zip(self._growth.values(), coefficients / scale, strict=True):
            parameter.value = value
        self._problem.solve(solver=self._solver, **self._options)
        if self._problem.status not in ("optimal", "optimal_inaccurate"):
            raise NumericalError(f"{label}: {self._solver} ended as {self._problem.status}", label)
        return float(self._rate.value) * scale, scale * np.array(
            [float(item.value) for item in self._multiplier.values()]
        )


def deposits(results: Path) -> list[Trajectory]:
    """Return the trajectories of the default study in the thesis's wording."""
    trajectories = []
    for path in sorted((results / "lifting").glob("*/pendulum.csv")):
        facts = read_json(path.with_suffix(".json"))
        facts["experience"] = facts["subject"]  # the twin's two people are called so
        in_thesis = pd.read_csv(path.with_name("thesis_pendulum.csv"))
        trajectories += LiftStates(pd.read_csv(path), facts, in_thesis).trajectories(THESIS)[0]
    return trajectories


def differences(items: list[Trajectory], areas: np.ndarray) -> np.ndarray:
    """Return the 18 cells of Table 4.1 in percent."""
    frame = pd.DataFrame([vars(item) for item in items])[
        ["subject", "experience", "box_mass_kg", "com", "plane"]
    ]
    comparisons = comparisons_of(list(zip(frame["experience"], frame["box_mass_kg"], strict=True)))
    rows = percent_differences(frame.assign(mean_area=areas), "mean_area", comparisons)
    return np.array([row[plane] for row in rows for plane in PLANES])


def row_of(items: list[Trajectory], solver: str, tolerance: float, result: Alternation) -> dict:
    """Return the results of one solver as a row."""
    cells = {
        number: differences(items, result.after[number - 1].mean_area) for number in (1, 2, ALTERNATIONS)
    }
    row = {"solver": solver, "tolerance": tolerance, "knots": len(result.funnels.level)}
    for number, values in cells.items():
        row |= {
            f"lowest_after_{number}_percent": values.min(),
            f"highest_after_{number}_percent": values.max(),
        }
    jumped = (result.jumps != 1).any(axis=0)
    row |= {"basins_that_jump": int(jumped.sum()), "knots_that_jump": int((result.jumps != 1).sum())}
    row |= {
        "largest_jump": result.jumps.max(),
        "cells_moved_by_jumps": int((np.abs(cells[2] - cells[1]) > 0.05).sum()),
    }
    row["mean_area_after_1"] = " ".join(f"{area:.4g}" for area in result.after[0].mean_area)
    return row | {"where": "; ".join(np.array([item.label for item in items])[jumped])}


def solvers(knots: int) -> list[tuple[str, float, int, Callable[[], object]]]:
    """Return solver, tolerance, knots and the function that makes the solver of step 1."""
    certificates = [
        ("Clarabel", tolerance, knots, lambda t=tolerance: Certificate(DEGREE, t)) for tolerance in TOLERANCES
    ]
    certificates += [
        ("Clarabel", ACCURACY, number, lambda: Certificate(DEGREE, ACCURACY))
        for number in (max(10, knots // 9), knots // 3, 2 * knots - 1)
    ]
    clarabel = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), ACCURACY)
    scs = dict.fromkeys(("eps_abs", "eps_rel"), ACCURACY)
    return [
        *certificates,
        ("Clarabel through cvxpy", ACCURACY, knots // 3, lambda: Written("CLARABEL", **clarabel)),
        ("SCS through cvxpy", ACCURACY, knots // 3, lambda: Written("SCS", **scs)),
    ]


def main() -> None:
    """Print a row per solver as soon as it is known, then write all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--knots", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=PROJECT / "results/benchmarks/alternation.csv")
    arguments = parser.parse_args()
    results = PROJECT / "results" / "thesis"
    items, rows = deposits(results), []
    if not items:
        parser.error(
            f"{results / 'lifting'} holds no lift's pendulum.csv: make them with `snakemake --cores 2 lifting`"
        )
    settings = StabilitySettings()
    options = {**vars(settings.thesis_method), "alternations": 2}
    loops: dict[int, ClosedLoops] = {}
    for solver, tolerance, knots, make in solvers(arguments.knots):
        # Euler's method keeps the thesis's step with fewer knots of ρ: they are taken evenly from its own.
        points = max(knots, arguments.knots)
        if points not in loops:
            loops[points] = close_loops(items, THESIS.sign, settings.model_copy(update={"knots": points}))
        alternation = alternate(loops[points], **{**options, "knots": knots}, certificate=make())
        rows.append(row_of(items, solver, tolerance, alternation))
        print(*(f"{name}: {value}" for name, value in rows[-1].items()), sep=", ", flush=True)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    write_csv(arguments.output, pd.DataFrame(rows))


if __name__ == "__main__":
    main()
