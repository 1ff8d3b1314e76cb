"""The thesis's criterion for Q and R: basins of the order of magnitude of the states (section 4.2.3.2); weights that meet it.

Q, R and Qf together times λ make S of Eq. 4.2 λ times as large and leave the feedback K = R⁻¹BᵀS of Eq. 4.4 as it is: the
pendulum is controlled as before, which is the thesis's other demand, and the goal set, and with it a basin in which the sine is
nearly linear, becomes 1/√λ as wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.lifting.stability.basins import RANGES, REACHES
from lumbar.lifting.stability.funnel.exact_funnel import exact_funnels
from lumbar.lifting.stability.model.eq_4_1_pendulum import gather
from lumbar.lifting.stability.model.eq_4_2_regulator import Weights, regulate, weights_of
from lumbar.lifting.stability.model.failures import attempts

if TYPE_CHECKING:
    from lumbar.lifting.stability.model.trajectories import Failure, Trajectory
    from lumbar.settings.stability import StabilitySettings

WITHIN = 10.0
"""A basin is of the order of magnitude of its movement if it reaches at most so many times as far, and at least 1/`WITHIN`."""
MOST_ROUNDS = 4
_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")


def reach_ratios(boa: pd.DataFrame) -> dict[str, np.ndarray]:
    """How many times the range of its movement each exact basin of ``boa.csv`` reaches from the trajectory, by state.

    A state that does not move has no order of magnitude and is left out.
    """
    rows = boa[boa["method"] == "exact"]
    found = {}
    for state, moved, reached in zip(("angle", "velocity"), RANGES, REACHES, strict=True):
        moves = rows[rows[moved] > 0]
        found[state] = (moves[reached] / moves[moved]).to_numpy(float)
    return found


def is_met(ratios: np.ndarray) -> bool:
    """Whether basins are of the order of magnitude of the states."""
    return bool((ratios <= WITHIN).all() and (ratios >= 1 / WITHIN).all())


def span(ratios: np.ndarray) -> str:
    """Say from how many to how many times."""
    return f"{ratios.min():.3g} to {ratios.max():.3g}"


@dataclass(frozen=True)
class TunedWeights:
    """Q, R and Qf times one factor, for all people and centres of mass, so that the basins are of the order of the states."""

    before: np.ndarray
    after: np.ndarray
    """`before`, `after`: reach over range of every basin and state, with the study's weights and with these."""
    factor: float
    """λ, of two digits: what a reader can type is what was computed."""
    areas: pd.DataFrame
    """Average cross-sections with these; columns ``subject, experience, box_mass_kg, com, plane, mean_area``."""
    failures: list[Failure] = field(default_factory=list)
    """Pendulums that have no basin with them."""

    def __str__(self) -> str:
        words = f"basins reach {span(self.before)} times as far as their movement ranges"
        if self.factor == 1:
            return f"{words}, which meets it"
        met = "meet it" if is_met(self.after) else "do not meet it either, nor does another factor"
        return f"{words}; Q, R and Qf times {self.factor:g}, with the same feedback, {met}: {span(self.after)} times"


def tuned_weights(
    trajectories: Sequence[Trajectory], sign: str, boa: pd.DataFrame, settings: StabilitySettings
) -> TunedWeights | None:
    """Find λ by λ ← λ·(smallest ratio)·(largest ratio), exact in a linear loop; None where nothing moves or has a basin.

    `boa` holds the basins of the same trajectories with the study's weights.
    """
    before = np.concatenate(list(reach_ratios(boa).values()))
    if not before.size:
        return None
    ratios, factor, own = before, 1.0, boa[boa["method"] == "exact"]
    areas, failures = own[[*_KEYS, "mean_area"]], []
    for _ in range(MOST_ROUNDS):
        if is_met(ratios):
            break
        factor = float(f"{factor * ratios.min() * ratios.max():.1e}")
        failures = []
        areas, ratios = _areas_and_ratios(trajectories, sign, factor, settings, failures)
    return TunedWeights(before, ratios, factor, areas, failures)


def _areas_and_ratios(
    trajectories: Sequence[Trajectory], sign: str, factor: float, settings: StabilitySettings, failures: list
) -> tuple[pd.DataFrame, np.ndarray]:
    """Average cross-sections with weights times a factor, and reach over range of the basins."""
    base, pendulum = weights_of(settings), settings.pendulum
    weights = Weights(factor * base.state, factor * base.control, factor * base.terminal)
    rows, ratios = [], [np.empty(0)]
    for attempt in attempts(list(trajectories), f"Table 4.1, Q, R and Qf times {factor:g}", failures):
        with attempt as some:
            constants = pendulum.damping_N_m_s, pendulum.gravity_m_s2, settings.grid.knots
            funnels = exact_funnels(regulate(gather(some, sign, *constants), weights), settings.goal_level)
            found = zip(some, funnels.mean_area, strict=True)
            rows += [{key: getattr(item, key) for key in _KEYS} | {"mean_area": area} for item, area in found]
            ranges = np.array([item.ranges for item in some])
            ratios.append(funnels.reach[ranges > 0] / ranges[ranges > 0])
    return pd.DataFrame(rows, columns=[*_KEYS, "mean_area"]), np.concatenate(ratios)
