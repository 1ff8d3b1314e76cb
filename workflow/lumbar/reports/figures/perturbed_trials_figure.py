"""Trials in the plane of the pendulum's states and their V/ρ over phase."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.reports.figures.style import DOUBLE_COLUMN, MEASURED, SEGMENTS, house_style, new_figure
from lumbar.stability.comparison.perturbed_trials import (
    PHASE_POINTS,
    Trial,
    funnel_of,
    mean_trajectory,
    relative_value,
)
from lumbar.stability.funnel.invariance import normal_axes

if TYPE_CHECKING:
    from lumbar.settings.perturbations import PerturbationsSettings
    from lumbar.settings.stability import StabilitySettings

COLOURS = {"unperturbed": SEGMENTS["thorax"], "perturbed": SEGMENTS["pelvis"]}
_CIRCLE = np.linspace(0.0, 2 * np.pi, 121)


@house_style
def trials_figure(trials: list[Trial], settings: PerturbationsSettings, stability: StabilitySettings):
    """Draw sections of the basin with all trials, and V/ρ of every trial over phase.

    Returns
    -------
    matplotlib.figure.Figure
    """
    unperturbed = [trial for trial in trials if trial.group == "unperturbed"]
    mean = mean_trajectory(unperturbed, settings)
    funnel = funnel_of(mean, stability)
    figure, (plane, values) = new_figure(DOUBLE_COLUMN, 3.2, ncols=2)
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
    for trial in trials:
        label = trial.group if trial.group not in named else None
        named.add(trial.group)
        colour = COLOURS[trial.group]
        plane.plot(trial.angle, trial.angular_velocity, color=colour, linewidth=0.8, label=label)
        own = mean_trajectory([item for item in unperturbed if item is not trial], settings)
        value = relative_value(trial, own, funnel_of(own, stability))
        values.plot(phase, value, color=colour, linewidth=0.9)
    plane.plot(mean.angle, mean.angular_velocity, color=MEASURED, linewidth=1.4, label="unperturbed mean")
    plane.set_xlabel("θ (rad)")
    plane.set_ylabel(r"$\dot\theta$ (rad/s)")
    values.axhline(1.0, color=MEASURED, linewidth=1.0)
    values.set_yscale("log")
    values.set_ylim(bottom=1e-2)
    values.set_xlabel("Phase (%)")
    values.set_ylabel("V/ρ (inside: ≤ 1)")
    handles, labels = plane.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure
