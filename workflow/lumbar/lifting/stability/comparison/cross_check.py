"""The sum-of-squares basins of a study against Eqs 4.5–4.7 written out in cvxpy, at some knots of each."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.basins import close_loops
from lumbar.lifting.stability.funnel.funnel import exact_funnels
from lumbar.lifting.stability.model.failures import Failure, all_or_each
from lumbar.lifting.stability.model.trajectory import Trajectory
from lumbar.lifting.stability.programme.cvxpy_formulation import AGREEMENT, rate_differences

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

CHECK = "sum_of_squares, Eq. 4.6 in cvxpy"


def cross_checked(
    boa: pd.DataFrame, trajectories: list[Trajectory], settings: StabilitySettings
) -> tuple[pd.DataFrame, list[Failure]]:
    """Fill ``sos_cvxpy_difference`` of the rows with the method sum_of_squares.

    Parameters
    ----------
    boa : pandas.DataFrame
        Summaries of all lifts, columns `lumbar.lifting.stability.basins.COLUMNS`.
    trajectories : list of Trajectory
        The sound ones of all lifts.

    Returns
    -------
    boa : pandas.DataFrame
    failures : list of Failure
        Basins at which the two formulations do not agree, or one of them has no optimum.
    """
    rows = boa["method"] == "sum_of_squares"
    if "cvxpy" not in settings.checks or not rows.any():
        return boa, []
    results, failures = all_or_each(_differences, trajectories, settings, basin=CHECK)
    found = {
        item.label: value for items, values in results for item, value in zip(items, values, strict=True)
    }
    failures += [
        Failure.of(
            item,
            CHECK,
            f"certified rates differ by {found[item.label]:.3g} 1/s; at most {AGREEMENT:g} 1/s is rounding",
        )
        for item in trajectories
        if found.get(item.label, 0.0) > AGREEMENT
    ]
    labels = boa.apply(
        lambda row: f"{row['subject']} {row['box_mass_kg']:g} kg, {row['com']}, {row['plane']}", axis=1
    )
    return boa.assign(sos_cvxpy_difference=labels.map(found).where(rows)), failures


def _differences(items: list[Trajectory], settings: StabilitySettings) -> np.ndarray:
    fewer = replace(settings, knots=settings.limits.knots)
    loops = close_loops(items, settings.pendulum.sign, fewer)
    level = exact_funnels(loops, settings.goal_level).level
    return rate_differences(loops, level, settings.sum_of_squares.degree, [0, loops.knots // 2])
