"""Figures 4.3 and 4.4: basins of attraction over angle, angular velocity and time; one section by every method."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from lumbar.lifting.stability.funnel.exact_funnel import Funnels
from lumbar.lifting.stability.funnel.lyapunov_family import best_of_family
from lumbar.lifting.stability.funnel.monte_carlo_check import preimage
from lumbar.lifting.stability.methods import METHODS, chosen_methods
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, close_loops, normal_axes
from lumbar.lifting.stability.model.failures import attempts
from lumbar.lifting.stability.model.trajectories import Trajectory
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SEGMENTS,
    house_style,
    new_figure,
    say_instead,
)

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.stability import StabilitySettings

PLANE_TITLES = {"flexion_extension": "Flexion/extension", "lateral_bending": "Lateral bending"}
NO_BASIN = "no basin: see tables/missing_basins"
GOAL = "#b03030"
"""Colour of the goal set; the trajectory alone is black."""
SECTIONS = 10
"""Cross-sections drawn per basin, at equal intervals."""
_CIRCLE = np.linspace(0.0, 2 * np.pi, 81)


def shown_lift(facts: list[dict], labels: dict[str, str], group: str) -> int:
    """Return the index of the lift shown: the heaviest box of a group, as the thesis shows its expert's.

    Parameters
    ----------
    facts : list of dict
        ``subject``, ``box_mass_kg`` and ``duration_s`` of every lift; without a deposit that is None, and another is shown.
    labels : dict of str to str
        Groups by subject.
    """
    deposited = [index for index, item in enumerate(facts) if item["duration_s"] is not None]
    candidates = deposited or range(len(facts))
    chosen = [index for index in candidates if labels[facts[index]["subject"]] == group]
    return max(chosen or candidates, key=lambda index: (facts[index]["box_mass_kg"], -index))


def ellipses(rows: pd.DataFrame, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return angle and angular velocity on {x̄ᵀSx̄ = level} about the reference, shapes (rows, points)."""
    s11, s12, s22 = (rows[name].to_numpy()[:, None] for name in ("s11", "s12", "s22"))
    determinant = s11 * s22 - s12**2
    root = np.sqrt(np.asarray(level))[:, None]
    first, second = np.cos(_CIRCLE), np.sin(_CIRCLE)
    error = root * np.sqrt(s22 / determinant) * first
    velocity = root * (second / np.sqrt(s22) - s12 / np.sqrt(s22 * determinant) * first)
    angle, speed = (rows[name].to_numpy()[:, None] for name in ("theta0_rad", "thetadot0_rad_s"))
    return angle + error, speed + velocity


@house_style
def figure_4_3(funnels: pd.DataFrame, terminal_level: float, who: str = "") -> Figure:
    """Draw the abdomen's funnel over time: the regulator's ellipses and the basin computed from them.

    Parameters
    ----------
    funnels : pandas.DataFrame
        Columns ``com, plane, time_s, rho, s11, s12, s22, theta0_rad, thetadot0_rad_s``.
    terminal_level : float
        ρ(T).
    who : str
        Person, box and convention, shown above.
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, ncols=2, subplot_kw={"projection": "3d"})
    for axis, (plane, title) in zip(axes, PLANE_TITLES.items(), strict=True):
        rows = funnels[(funnels["com"] == "abdomen") & (funnels["plane"] == plane)]
        axis.set_title(f"{title}, abdomen" + (f"\n{who}" if who else ""))
        if len(rows):
            _draw_funnel(axis, rows, terminal_level)
        else:
            axis.text2D(0.5, 0.5, NO_BASIN, transform=axis.transAxes, ha="center")
    shared_legend(figure, axes, ncols=4)
    return figure


def _draw_funnel(axis, rows: pd.DataFrame, terminal_level: float) -> None:
    from matplotlib.ticker import MaxNLocator

    every = rows.iloc[np.linspace(0, len(rows) - 1, 40).round().astype(int)]
    time = np.broadcast_to(every["time_s"].to_numpy()[:, None], (len(every), len(_CIRCLE)))
    angle, velocity = ellipses(every, every["rho"].to_numpy())
    axis.plot_surface(
        time, angle, velocity, color=SEGMENTS["abdomen"], alpha=0.3, linewidth=0, rstride=1, cstride=4
    )
    few = rows.iloc[np.linspace(0, len(rows) - 1, 9).round().astype(int)]
    regulator = ellipses(few, np.full(len(few), terminal_level))
    basin = ellipses(few, few["rho"].to_numpy())
    for index, moment in enumerate(few["time_s"]):
        at = np.full(len(_CIRCLE), moment)
        last = index == len(few) - 1
        named = index == 0
        label = "regulator, V = ρ(T)" if named else None
        look = {"color": "#555555", "linewidth": 0.7, "linestyle": (0, (2, 1))}
        axis.plot(at, regulator[0][index], regulator[1][index], label=label, **look)
        label = "basin, V = ρ(t)" if named else "goal set" if last else None
        look = {"color": "#8a5a00", "linewidth": 0.9, "linestyle": "-"}
        if last:
            look = {"color": GOAL, "linewidth": 1.8, "linestyle": (0, (4, 1))}
        axis.plot(at, basin[0][index], basin[1][index], label=label, **look)
    trajectory = (rows[name] for name in ("time_s", "theta0_rad", "thetadot0_rad_s"))
    axis.plot(*trajectory, color=MEASURED, linewidth=1.4, label="trajectory")
    axis.set_xlabel("Time (s)", labelpad=-2)
    axis.set_ylabel("θ (rad)", labelpad=-3)
    axis.set_zlabel(r"$\dot\theta$ (rad/s)", labelpad=-3)
    axis.tick_params(pad=-2)
    axis.tick_params(axis="z", pad=1)
    axis.view_init(elev=22, azim=-60)
    for direction in (axis.xaxis, axis.yaxis, axis.zaxis):
        direction.set_major_locator(MaxNLocator(4))
    axis.set_box_aspect((1.5, 1.1, 1), zoom=0.98)


@house_style
def figure_4_4(funnels: pd.DataFrame, who: str = "") -> Figure:
    """Draw the basins of every COM and plane about their trajectories, in error coordinates; the trajectory in an inset.

    Parameters are those of `figure_4_3`.
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 6.6, nrows=len(SEGMENTS), ncols=2, sharex=True, sharey=True)
    for row, (com, colour) in zip(axes, SEGMENTS.items(), strict=True):
        for axis, (plane, title) in zip(row, PLANE_TITLES.items(), strict=True):
            rows = funnels[(funnels["com"] == com) & (funnels["plane"] == plane)]
            if len(rows):
                _draw_basin(axis, rows, colour)
            else:
                say_instead(axis, NO_BASIN)
            if com == "thorax":
                axis.set_title(title + (f"\n{who}" if who else ""))
        row[0].set_ylabel(f"{com.capitalize()}\n" + r"$\dot\theta - \dot\theta_0$ (rad/s)")
    for axis in axes[-1]:
        axis.set_xlabel("θ − θ0 (rad)")
    drawn = [axis for axis in axes.ravel() if axis.collections]
    for axis in drawn:
        axis.autoscale_view()
    shared_legend(figure, [*drawn[:1], *(child for axis in drawn[:1] for child in axis.child_axes)], ncols=5)
    return figure


def shared_legend(figure, axes, ncols: int) -> None:
    """Put the labels of all axes, each once, above the figure."""
    labelled = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
    if labelled:
        figure.legend(labelled.values(), labelled.keys(), loc="outside upper center", ncols=ncols)


def _draw_basin(axis, rows: pd.DataFrame, colour: str) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    still = rows.assign(theta0_rad=0.0, thetadot0_rad_s=0.0)
    every = still.iloc[np.linspace(0, len(still) - 1, SECTIONS).round().astype(int)]
    angle, velocity = ellipses(every, every["rho"].to_numpy())
    later = np.linspace(0.25, 1.0, SECTIONS)
    edges = np.stack([angle, velocity], axis=-1)
    look = {"edgecolors": [to_rgba(colour, alpha) for alpha in later], "linewidths": 0.8}
    label = f"{SECTIONS} sections, darker later"
    axis.add_collection(PolyCollection(edges, facecolors=to_rgba(colour, 0.05), label=label, **look))
    axis.set_axisbelow(True)
    dashed = {"linewidth": 1.4, "linestyle": (0, (4, 1.5))}
    axis.plot(angle[0], velocity[0], color=colour, label="basin at t = 0", **dashed)
    axis.plot(angle[-1], velocity[-1], color=GOAL, linewidth=1.4, label="goal set")
    _inset(axis, rows)


def _inset(axis, rows: pd.DataFrame) -> None:
    """Draw the trajectory itself at its own scale, in the corner that basins leave empty."""
    inset = axis.inset_axes([0.66, 0.62, 0.33, 0.36])
    inset.plot(
        rows["theta0_rad"], rows["thetadot0_rad_s"], color=MEASURED, linewidth=1.0, label="trajectory (inset)"
    )
    first = rows[["theta0_rad", "thetadot0_rad_s"]].iloc[0]
    inset.plot(*first, color=MEASURED, marker="o", markersize=3, linestyle="", label="start")
    inset.tick_params(labelsize=5, length=2, pad=1)
    inset.set_xlabel("θ0 (rad)", fontsize=5.5, labelpad=0)
    inset.set_ylabel(r"$\dot\theta_0$ (rad/s)", fontsize=5.5, labelpad=0)
    inset.locator_params(nbins=3)


STYLES = {
    "exact": ("exact", {"color": SEGMENTS["abdomen"], "linewidth": 1.8}),
    "sum_of_squares": ("sum of squares", {"color": MEASURED, "linewidth": 0.9, "linestyle": (0, (2, 2))}),
    "thesis": ("thesis (no certificate)", {"color": "#b03030", "linewidth": 1.1, "linestyle": (0, (5, 2))}),
    "best": ("best V of the family", {"color": SEGMENTS["pelvis"], "linewidth": 1.4}),
}
_FINE_CIRCLE = np.linspace(0.0, 2 * np.pi, 241)


@house_style
def comparison_figure(trajectories: list[Trajectory], settings: StabilitySettings, who: str = "") -> Figure:
    """Draw the sections at t = 0 of the abdomen's basins in both planes, in error coordinates; of one lift's trajectories."""
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, ncols=2, sharex=True, sharey=True)
    drawn = _sections([item for item in trajectories if item.com == "abdomen"], settings)
    for axis, (plane, title) in zip(axes, PLANE_TITLES.items(), strict=True):
        if "exact" in drawn.get(plane, {}):
            _draw(axis, drawn[plane])
        else:
            say_instead(axis, NO_BASIN)
        axis.set(title=f"{title}, abdomen" + (f"\n{who}" if who else ""), xlabel="θ − θ0 (rad)")
    axes[0].set_ylabel(r"$\dot\theta - \dot\theta_0$ (rad/s)")
    shared_legend(figure, axes, ncols=3)
    return figure


def _sections(shown: list[Trajectory], settings: StabilitySettings) -> dict[str, dict[str, np.ndarray]]:
    """Edges of all sections at t = 0, shape (2, points), by plane and method, with the goal set and all that reach it."""
    # A picture needs no more knots than the other variants, and no proof.
    fewer = replace(settings, knots=settings.limits.knots, checks=())
    found: dict[str, dict[str, np.ndarray]] = {item.plane: {} for item in shown}
    for name in (*chosen_methods(settings), "best"):
        computed = []
        for attempt in attempts(shown, name, []):
            with attempt as items:
                computed.append((items, *_funnels(items, name, fewer)))
        for items, loops, funnels in computed:
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
        return loops, best_of_family(loops, settings.goal_level, settings.lyapunov_shares).exact
    return loops, METHODS[name](loops, settings).funnels


def _section(funnels: Funnels, knot: int) -> np.ndarray:
    """Edge of one section, shape (2, pendulums, points)."""
    a, p, q = (axis[:, None] for axis in normal_axes(funnels.cost[knot]))
    root = np.sqrt(funnels.level[knot])[:, None]
    return root * np.stack([a * np.cos(_FINE_CIRCLE), p * np.cos(_FINE_CIRCLE) + q * np.sin(_FINE_CIRCLE)])
