"""One section in one picture: the methods' basins at t = 0, a better V, and everything that reaches the goal."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.funnel.exact_funnel import Funnels
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.monte_carlo_check import preimage
from lumbar.lifting.stability.methods import METHODS, chosen_methods
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, close_loops, normal_axes
from lumbar.lifting.stability.model.failures import all_or_each
from lumbar.lifting.stability.model.trajectories import Trajectory
from lumbar.publishing.figures.stability_figures import NO_BASIN, PLANE_TITLES, shared_legend
from lumbar.publishing.figures.style import DOUBLE_COLUMN, MEASURED, SEGMENTS, house_style, new_figure

if TYPE_CHECKING:
    from lumbar.settings.stability import StabilitySettings

STYLES = {
    "exact": ("exact", {"color": SEGMENTS["abdomen"], "linewidth": 1.8}),
    "sum_of_squares": ("sum of squares", {"color": MEASURED, "linewidth": 0.9, "linestyle": (0, (2, 2))}),
    "thesis": ("thesis (no certificate)", {"color": "#b03030", "linewidth": 1.1, "linestyle": (0, (5, 2))}),
    "best": ("best V of the family", {"color": SEGMENTS["pelvis"], "linewidth": 1.4}),
}
_CIRCLE = np.linspace(0.0, 2 * np.pi, 241)


@house_style
def comparison_figure(trajectories: list[Trajectory], settings: StabilitySettings, who: str = ""):
    """Draw the sections at t = 0 of the abdomen's basins in both planes, in error coordinates.

    Parameters
    ----------
    trajectories : list of Trajectory
        Of one lift.
    who : str
        Person, box and convention, shown above.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, ncols=2, sharex=True, sharey=True)
    drawn = _sections([item for item in trajectories if item.com == "abdomen"], settings)
    for axis, (plane, title) in zip(axes, PLANE_TITLES.items(), strict=True):
        if "exact" in drawn.get(plane, {}):
            _draw(axis, drawn[plane])
        else:
            axis.text(0.5, 0.5, NO_BASIN, transform=axis.transAxes, ha="center")
        axis.set_title(f"{title}, abdomen" + (f"\n{who}" if who else ""))
        axis.set_xlabel("θ − θ0 (rad)")
    axes[0].set_ylabel(r"$\dot\theta - \dot\theta_0$ (rad/s)")
    shared_legend(figure, axes, ncols=3)
    return figure


def _sections(shown: list[Trajectory], settings: StabilitySettings) -> dict[str, dict[str, np.ndarray]]:
    """Edges of all sections at t = 0, shape (2, points), by plane and method, with the goal set and all that reach it."""
    # A picture needs no more knots than the other variants, and no proof.
    fewer = replace(settings, knots=settings.limits.knots, checks=())
    found: dict[str, dict[str, np.ndarray]] = {item.plane: {} for item in shown}
    for name in (*chosen_methods(settings), "best"):
        for items, (loops, funnels) in all_or_each(_funnels, shown, name, fewer, basin=name)[0]:
            first = _section(funnels, 0)
            for index, item in enumerate(items):
                found[item.plane][name] = first[:, index]
            if name == "exact":
                goal = _section(funnels, -1)
                reached = preimage(loops, goal)
                for index, item in enumerate(items):
                    found[item.plane] |= {"goal": goal[:, index], "reached": reached[:, index]}
    return found


def _draw(axis, sections: dict[str, np.ndarray]) -> None:
    """Draw the sections of one trajectory."""
    grey = {"facecolor": "#00000014", "edgecolor": "#777777", "linewidth": 0.8}
    axis.fill(*sections["reached"], label="all that reach the goal", **grey)
    basins = [sections[name] for name in STYLES if name in sections]
    for name, (label, style) in STYLES.items():
        if name in sections:
            axis.plot(*sections[name], label=label, **style)
    axis.plot(*sections["goal"], color="#777777", linewidth=0.8, linestyle=":", label="goal set (at T)")
    largest = np.concatenate(basins, axis=1)
    # What reaches the goal may reach far beyond: the picture shows the basins.
    for limit, extent in zip((axis.set_xlim, axis.set_ylim), 1.3 * np.abs(largest).max(axis=1), strict=True):
        limit(-extent, extent)
    share = 100 * _enclosed(sections["exact"]) / _enclosed(sections["reached"])
    words = f"exact: {share:.2g} % of all that reach the goal"
    white = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    axis.text(0.98, 0.96, words, transform=axis.transAxes, ha="right", va="top", fontsize=6, bbox=white)


def _enclosed(edge: np.ndarray) -> float:
    """Area inside a closed curve, shape (2, points), by the shoelace formula."""
    x, y = edge
    return 0.5 * abs(float(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))


def _funnels(
    trajectories: list[Trajectory], name: str, settings: StabilitySettings
) -> tuple[ClosedLoops, Funnels]:
    loops = close_loops(trajectories, settings.pendulum.sign, settings)
    if name == "best":
        return loops, best_of_family(loops, settings.goal_level, settings.lyapunov_shares).funnels
    return loops, METHODS[name](loops, settings).funnels


def _section(funnels: Funnels, knot: int) -> np.ndarray:
    """Edge of one section, shape (2, pendulums, points)."""
    a, p, q = (axis[:, None] for axis in normal_axes(funnels.cost[knot]))
    root = np.sqrt(funnels.level[knot])[:, None]
    return root * np.stack([a * np.cos(_CIRCLE), p * np.cos(_CIRCLE) + q * np.sin(_CIRCLE)])
