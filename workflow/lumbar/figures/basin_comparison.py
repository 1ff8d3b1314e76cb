"""One section in one picture: the engines' basins at t = 0, a better V, and everything that reaches the goal."""

from __future__ import annotations

import numpy as np

from lumbar.figures.style import DOUBLE_COLUMN, MEASURED, SEGMENTS, new_figure
from lumbar.stability.basins import close_loops
from lumbar.stability.engines import ENGINES, chosen_engines
from lumbar.stability.funnel import Funnels
from lumbar.stability.invariance import normal_axes
from lumbar.stability.lyapunov_family import best_of_family
from lumbar.stability.simulation import preimage
from lumbar.stability.trajectory import Trajectory

TITLES = {"lateral_bending": "Lateral bending", "flexion_extension": "Flexion/extension"}
STYLES = {
    "exact": ("exact", {"color": SEGMENTS["abdomen"], "linewidth": 1.8}),
    "sum_of_squares": ("sum of squares", {"color": MEASURED, "linewidth": 0.9, "linestyle": (0, (2, 2))}),
    "thesis": ("thesis (no certificate)", {"color": "#b03030", "linewidth": 1.1, "linestyle": (0, (5, 2))}),
    "best": ("best V of the family", {"color": SEGMENTS["pelvis"], "linewidth": 1.4}),
}
_CIRCLE = np.linspace(0.0, 2 * np.pi, 241)


def comparison_figure(trajectories: list[Trajectory], settings: dict):
    """Draw the sections at t = 0 of the abdomen's basins in both planes, in error coordinates.

    Parameters
    ----------
    trajectories : list of Trajectory
        Of one lift.
    settings : dict
        Section ``stability`` of the configuration.

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown = [item for item in trajectories if item.com == "abdomen"]
    # A picture needs no more knots than the other variants.
    fewer = {**settings, "knots": settings["limits"]["knots"]}
    loops = close_loops(shown, settings["pendulum"]["sign"], fewer)
    without_proof = {**settings, "proof": None}
    sections = {name: ENGINES[name](loops, without_proof).funnels for name in chosen_engines(settings)}
    best = best_of_family(loops, settings["goal_level"], settings["lyapunov_shares"], margin=0.0)
    sections["best"] = best.funnels
    goal = _section(sections["exact"], -1)
    reached = preimage(loops, goal)
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, ncols=2, sharex=True, sharey=True)
    for index, (axis, item) in enumerate(zip(axes, shown, strict=True)):
        axis.fill(
            *reached[:, index],
            facecolor="#00000014",
            edgecolor="#777777",
            linewidth=0.8,
            label="all that reach the goal",
        )
        for name, funnels in sections.items():
            label, style = STYLES[name]
            axis.plot(*_section(funnels, 0)[:, index], label=label, **style)
        axis.plot(*goal[:, index], color="#777777", linewidth=0.8, linestyle=":", label="goal set (at T)")
        axis.set_title(TITLES[item.plane])
        axis.set_xlabel("θ − θ0 (rad)")
    axes[0].set_ylabel(r"$\dot\theta - \dot\theta_0$ (rad/s)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def _section(funnels: Funnels, knot: int) -> np.ndarray:
    """Edge of one section, shape (2, pendulums, points)."""
    a, p, q = (axis[:, None] for axis in normal_axes(funnels.cost[knot]))
    root = np.sqrt(funnels.level[knot])[:, None]
    return root * np.stack([a * np.cos(_CIRCLE), p * np.cos(_CIRCLE) + q * np.sin(_CIRCLE)])
