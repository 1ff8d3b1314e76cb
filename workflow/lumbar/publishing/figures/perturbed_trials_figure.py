"""Trials in the plane of the pendulum's states and their V/ρ over phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.comparison.perturbed_trials import (
    PHASE_POINTS,
    Trial,
    funnel_of,
    mean_trajectory,
    references,
    values_of,
)
from lumbar.lifting.stability.model.eq_4_2_regulator import normal_axes
from lumbar.publishing.figures.style import DOUBLE_COLUMN, MEASURED, SEGMENTS, house_style, new_figure

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.perturbations import PerturbationsSettings
    from lumbar.settings.stability import StabilitySettings

COLOURS = {"unperturbed": SEGMENTS["thorax"], "perturbed": SEGMENTS["pelvis"]}
_CIRCLE = np.linspace(0.0, 2 * np.pi, 121)


@house_style
def trials_figure(
    trials: list[Trial],
    by_weight: pd.DataFrame,
    settings: PerturbationsSettings,
    stability: StabilitySettings,
):
    """Draw sections of the basin with all trials, V/ρ of every trial over phase, and how many lie inside by R and sign.

    Returns
    -------
    matplotlib.figure.Figure
    """
    unperturbed = [trial for trial in trials if trial.group == "unperturbed"]
    mean = mean_trajectory(unperturbed, settings)
    funnel = funnel_of(mean, stability)
    figure, (plane, values, counts) = new_figure(DOUBLE_COLUMN, 3.0, ncols=3)
    root = np.sqrt(funnel.level[:, 0])
    a, p, q = (root * axis[:, 0] for axis in normal_axes(funnel.cost))
    for knot in np.linspace(0, PHASE_POINTS - 1, 12).round().astype(int):
        plane.fill(
            mean.angle[knot] + a[knot] * np.cos(_CIRCLE),
            mean.angular_velocity[knot] + p[knot] * np.cos(_CIRCLE) + q[knot] * np.sin(_CIRCLE),
            facecolor="#00000010",
            edgecolor="#555555",
            linewidth=0.5,
            label="basin of the mean" if knot == 0 else None,
        )
    phase = np.linspace(0.0, 100.0, PHASE_POINTS)
    named = set()
    each = values_of(trials, references(trials, settings), stability.pendulum.sign, stability)
    for trial, value in zip(trials, each, strict=True):
        label = trial.group if trial.group not in named else None
        named.add(trial.group)
        colour = COLOURS[trial.group]
        plane.plot(trial.angle, trial.angular_velocity, color=colour, linewidth=0.8, label=label)
        values.plot(phase, value, color=colour, linewidth=0.9)
    plane.plot(mean.angle, mean.angular_velocity, color=MEASURED, linewidth=1.4, label="unperturbed mean")
    plane.set_xlabel("θ (rad)")
    plane.set_ylabel(r"$\dot\theta$ (rad/s)")
    values.axhline(1.0, color=MEASURED, linewidth=1.0)
    values.set_yscale("log")
    values.set_ylim(bottom=1e-2)
    values.set_xlabel("Phase (%)")
    values.set_ylabel("V/ρ (inside: ≤ 1)")
    _draw_counts(counts, by_weight, stability)
    handles, labels = plane.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def _draw_counts(axis, by_weight: pd.DataFrame, stability: StabilitySettings) -> None:
    """Draw how many trials lie inside throughout over the control weight; the study's is marked."""
    for (sign, group), rows in by_weight.groupby(["sign", "group"], sort=False):
        standing = sign == "inverted"
        axis.plot(
            rows["control_weight"],
            rows["inside"],
            color=COLOURS[group],
            linestyle="-" if standing else (0, (3, 2)),
            marker="o" if group == "unperturbed" else "s",
            markersize=4 if standing else 3,
            markerfacecolor=COLOURS[group] if standing else "white",
            label=f"{group}, {sign}",
        )
    axis.axvline(stability.regulator.control_weight, color="#777777", linewidth=0.8, linestyle=":")
    axis.set_xscale("log")
    # Room above the counts for the legend.
    most = int(by_weight["inside"].max())
    axis.set_ylim(-0.4, 1.7 * max(most, 1))
    axis.set_yticks(range(most + 1))
    axis.set_xlabel("R (1/(N²·m²·s))")
    axis.set_ylabel("Trials inside throughout")
    axis.legend(fontsize=5.5, loc="upper center")
