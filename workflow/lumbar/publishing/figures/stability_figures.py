"""Figures 4.3 and 4.4: basins in the phase plane by the thesis's method and the exact method; one section by every method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from lumbar.lifting.stability.basins import METHODS, thesis_methods
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, best_of_family
from lumbar.lifting.stability.funnel.monte_carlo_check import preimage
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import close_loops, normal_axes
from lumbar.lifting.stability.model.pendulum_trajectories import THESIS, Trajectory, compute_together
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SEGMENTS,
    house_style,
    new_figure,
    show_placeholder,
)
from lumbar.settings.lifting import StabilitySettings

if TYPE_CHECKING:
    import pandas as pd


PLANE_TITLES = {"flexion_extension": "Flexion/extension", "lateral_bending": "Lateral bending"}
NO_BASIN = "no basin: see tables/missing_basins"
GOAL = "#b03030"
"""Colour of the goal set, different from the black trajectory."""
SECTIONS = 5
"""Number of cross-sections drawn per basin, at equal intervals."""
_CIRCLE = np.linspace(0.0, 2 * np.pi, 81)


def select_lift(facts: list[dict], labels: dict[str, str], group: str) -> int:
    """Return the index of the lift to show: a group's lift of the heaviest box, as the thesis shows the expert's.

    `facts` has ``subject``, ``box_mass_kg`` and ``duration_s`` of every lift; lifts without a deposit have a duration of None and
    are not shown. `labels` are the groups by subject, `group` is the group to show, if it has a lift.
    """
    deposited = [index for index, item in enumerate(facts) if item["duration_s"] is not None]
    candidates = deposited or range(len(facts))
    in_group = [index for index in candidates if labels[facts[index]["subject"]] == group]
    return max(in_group or candidates, key=lambda index: (facts[index]["box_mass_kg"], -index))


def _ellipses(cost: np.ndarray, level: np.ndarray, circle: np.ndarray = _CIRCLE) -> np.ndarray:
    """Return errors of angle and angular velocity on {x̄ᵀSx̄ = level}, shape (2, rows, points).

    `cost` is S as s11, s12, s22, shape (rows, 3); `level` has shape (rows,).
    """
    a, p, q = (np.sqrt(level)[:, None] * axis[:, None] for axis in normal_axes(cost))
    return np.stack([a * np.cos(circle), p * np.cos(circle) + q * np.sin(circle)])


_COST, _REFERENCE = ["s11", "s12", "s22"], ["theta0_rad", "thetadot0_rad_s"]


@dataclass(frozen=True)
class _Variant:
    """A column of Figures 4.3 and 4.4: a method with the pendulums of thesis or study."""

    wording: str
    """Convention of the pendulums: ``thesis`` or ``study``."""
    method: str
    """Method of the basins: ``thesis`` or ``exact``."""
    title: str
    level: float
    """Level V of the regulator's ellipses from which the method starts."""

    def select(self, funnels: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of this variant in a table of funnels."""
        return funnels[(funnels["wording"] == self.wording) & (funnels["method"] == self.method)]


def _variants(funnels: pd.DataFrame, settings: StabilitySettings) -> list[_Variant]:
    """Return the drawn variants, from the thesis's method with its pendulums to the exact method with the study's."""
    thesis, study = (
        f"{choice.sign}, {choice.time} time, {choice.mass.replace('_', ' ')}"
        for choice in (THESIS, settings.pendulum)
    )
    goal, initial = settings.goal_level, settings.thesis_method.initial_level
    every = (
        _Variant("thesis", "thesis", f"Eqs 4.5–4.7, no certificate\n{thesis}", initial),
        _Variant("thesis", "exact", f"exact\n{thesis}", goal),
        _Variant("study", "exact", f"exact\n{study}", goal),
    )
    return [item for item in every if item is every[-1] or len(item.select(funnels))]


def _pendulum(rows: pd.DataFrame, com: str, plane: str) -> pd.DataFrame:
    return rows[(rows["com"] == com) & (rows["plane"] == plane)]


@house_style
def figure_4_3(funnels: pd.DataFrame, settings: StabilitySettings) -> Figure:
    """Draw the abdomen's basins in the θ-θ̇ plane, the regulator's ellipses from which they are expanded, and ρ(t).

    `funnels` is ``funnel.csv`` of one lift; `settings` has the goal set and the initial level of the thesis's method.
    """
    shown = _variants(funnels, settings)
    figure, axes = new_figure(DOUBLE_COLUMN, 6.2, nrows=3, ncols=len(shown), squeeze=False)
    for axis in axes[2, 1:]:
        axis.sharey(axes[2, 0])
    for column, variant in zip(axes.T, shown, strict=True):
        for axis, plane in zip(column, PLANE_TITLES, strict=False):
            rows = _pendulum(variant.select(funnels), "abdomen", plane)
            if not len(rows):
                show_placeholder(axis, NO_BASIN)
                continue
            _draw_basin(axis, rows, SEGMENTS["abdomen"], variant.level)
            phase = rows["time_s"] / rows["time_s"].iloc[-1]
            column[2].plot(phase, rows["rho"], label=PLANE_TITLES[plane], **_PLANE_LOOKS[plane])
        column[0].set_title(variant.title)
        column[1].set_xlabel("θ (rad)")
        abdomen = variant.select(funnels).query("com == 'abdomen'")
        column[2].set_title(compare_with_regulator(abdomen, variant.level).replace(", ", "\n"))
        column[2].set(xlabel="Time $t/T$", xlim=(0, 1))
    _share_frames(axes[:2], [item.wording for item in shown])
    for axis, plane in zip(axes[:, 0], PLANE_TITLES.values(), strict=False):
        axis.set_ylabel(f"{plane}\n" + r"$\dot\theta$ (rad/s)")
    axes[2, 0].set_ylabel("ρ, basin V ≤ ρ(t)")
    if axes[2, -1].lines:
        axes[2, -1].legend(loc="upper right")
    _add_shared_legend(figure, axes[0])
    return figure


@house_style
def figure_4_4(funnels: pd.DataFrame, settings: StabilitySettings) -> Figure:
    """Draw the basins of every COM and plane about their trajectories, by the thesis's method and by the exact method.

    For parameters see `figure_4_3`.
    """
    every = _variants(funnels, settings)
    shown = [(item, plane) for item in dict.fromkeys((every[0], every[-1])) for plane in PLANE_TITLES]
    figure, axes = new_figure(DOUBLE_COLUMN, 1.9 * len(shown) + 0.5, nrows=len(shown), ncols=len(SEGMENTS))
    for row, (variant, plane) in zip(axes, shown, strict=True):
        for axis, (com, colour) in zip(row, SEGMENTS.items(), strict=True):
            rows = _pendulum(variant.select(funnels), com, plane)
            if len(rows):
                _draw_basin(axis, rows, colour, inset=False)
            else:
                show_placeholder(axis, NO_BASIN)
        method = variant.title.partition("\n")[0]
        row[0].set_ylabel(f"{PLANE_TITLES[plane]}\n{method}\n" + r"$\dot\theta$ (rad/s)")
    for column, com in zip(axes.T, SEGMENTS, strict=True):
        column[0].set_title(com.capitalize())
        column[-1].set_xlabel("θ (rad)")
    _share_frames(axes.T, [variant.wording for variant, _ in shown], head=1.3)
    _add_shared_legend(figure, axes[0])
    variants = dict.fromkeys(variant for variant, _ in shown)
    lines = [f"{item.title}: {compare_with_regulator(item.select(funnels), item.level)}" for item in variants]
    figure.supxlabel("\n".join(line.replace("\n", ", ") for line in lines), fontsize=6.5)
    return figure


def compare_with_regulator(funnels: pd.DataFrame, level: float) -> str:
    """Return whether basins at t = 0 are inside the regulator's ellipses V ≤ level or around them; empty without basins.

    Both are ellipses of the same V, so their levels decide. `funnels` has the rows of one variant in ``funnel.csv``.
    """
    first = funnels.groupby(["com", "plane"])["rho"].first()
    if first.empty:
        return ""
    place = "inside" if (first < level).all() else "around" if (first > level).all() else "not always inside"
    return f"at t = 0 {place} the regulator's ellipse, ρ(0) = {first.min():.2f} to {first.max():.2f}"


_PLANE_LOOKS: dict[str, dict] = {
    "flexion_extension": {"color": MEASURED, "linewidth": 1.4},
    "lateral_bending": {"color": SEGMENTS["abdomen"], "linewidth": 1.1, "linestyle": (0, (3, 1.5))},
}


def _share_frames(axes, wordings: list[str], head: float = 2.2) -> None:
    """Set common limits for columns of panels with the same pendulums, with `head` times the basins' height above the centre."""
    for wording in dict.fromkeys(wordings):
        alike = axes[:, [item == wording for item in wordings]].ravel()
        edges = [axis.collections[0].get_datalim(axis.transData) for axis in alike if axis.collections]
        reach = np.max([np.abs([box.min, box.max]).max(axis=0) for box in edges], axis=0) if edges else (1, 1)
        for axis in alike:
            axis.set(xlim=(-1.3 * reach[0], 1.3 * reach[0]), ylim=(-1.3 * reach[1], head * reach[1]))


def _add_shared_legend(figure, axes) -> None:
    """Draw one legend above the figure with the labels of all axes and insets, without repetitions."""
    labelled = {}
    insets = [inset for axis in axes for inset in axis.child_axes]
    for panel in [*axes, *insets]:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
    if labelled:
        figure.legend(labelled.values(), labelled.keys(), loc="outside upper center", ncols=3)


def _draw_basin(
    axis, rows: pd.DataFrame, colour: str, regulator: float | None = None, inset: bool = True
) -> None:
    """Draw the sections of one basin, the goal set, the trajectory, and the regulator's ellipse if `regulator` is given."""
    every = rows.iloc[np.linspace(0, len(rows) - 1, SECTIONS).round().astype(int)]
    errors = _ellipses(every[_COST].to_numpy(), every["rho"].to_numpy())
    edges = every[_REFERENCE].to_numpy()[:, None] + np.moveaxis(errors, 0, -1)
    later = np.linspace(0.3, 1.0, SECTIONS)
    look = {"edgecolors": [to_rgba(colour, alpha) for alpha in later], "linewidths": 0.8}
    label = f"{SECTIONS} sections, darker later"
    axis.add_collection(PolyCollection(edges, facecolors=to_rgba(colour, 0.05), label=label, **look))
    axis.set_axisbelow(True)
    axis.plot(*edges[0].T, color=colour, label="basin at t = 0", linewidth=1.4, linestyle=(0, (4, 1.5)))
    if regulator is not None:
        first = rows.iloc[:1]
        ellipse = _ellipses(first[_COST].to_numpy(), np.array([regulator]))[:, 0]
        dotted = {"color": "#555555", "linewidth": 0.9, "linestyle": (0, (1, 1.2))}
        edge = first[_REFERENCE].to_numpy().T + ellipse
        axis.plot(*edge, label=f"regulator, V ≤ {regulator:g}, t = 0", **dotted)
    axis.plot(*edges[-1].T, color=GOAL, linewidth=1.4, label="section at T")
    angle, velocity = (rows[name] for name in _REFERENCE)
    ink = {"color": MEASURED, "linewidth": 0.8}
    axis.plot(angle, velocity, label="trajectory" + (", enlarged in the corner" if inset else ""), **ink)
    if not inset:
        return
    # The trajectory again, enlarged in a corner without basins, with its ranges below.
    corner = axis.inset_axes([0.76, 0.79, 0.23, 0.2])
    corner.plot(angle, velocity, **ink)
    start = {"marker": "o", "markersize": 3, "linestyle": "", "label": "its start"}
    corner.plot(angle.iloc[:1], velocity.iloc[:1], color=MEASURED, **start)
    corner.set(xticks=[], yticks=[])
    ranges = f"{np.ptp(angle):.2g} rad\n{np.ptp(velocity):.2g} rad/s"
    corner.set_xlabel(ranges, fontsize=6, labelpad=1, linespacing=0.95)


STYLES = {
    "exact": ("exact", {"color": SEGMENTS["abdomen"], "linewidth": 1.8}),
    "thesis": ("thesis (no certificate)", {"color": "#b03030", "linewidth": 1.1, "linestyle": (0, (5, 2))}),
    "best": ("best V of the family", {"color": SEGMENTS["pelvis"], "linewidth": 1.4}),
}
_FINE_CIRCLE = np.linspace(0.0, 2 * np.pi, 241)


@house_style
def method_comparison_figure(
    trajectories: list[Trajectory], funnels: pd.DataFrame, settings: StabilitySettings, who: str = ""
) -> Figure:
    """Draw the sections at t = 0 of the abdomen's basins in both planes, in error coordinates, by every method.

    `trajectories` are those of one lift and `funnels` its ``funnel.csv``; the thesis's method and the best V are computed
    on the same pendulums. `settings` has regulator, goal set, methods and knots; `who` has subject and box for the titles.
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, ncols=2, sharex=True, sharey=True)
    abdomen = [item for item in trajectories if item.com == "abdomen"]
    known = funnels[(funnels["wording"] == "study") & (funnels["com"] == "abdomen")]
    sections = _sections(abdomen, known, settings)
    for axis, (plane, title) in zip(axes, PLANE_TITLES.items(), strict=True):
        if "reached" in sections.get(plane, {}):
            _draw_sections(axis, sections[plane])
        else:
            show_placeholder(axis, NO_BASIN)
        lines = [f"{title}, abdomen", *([who] if who else [])]
        axis.set(title="\n".join(lines), xlabel="$\\theta - \\theta_0$ (rad)")
    axes[0].set_ylabel(r"$\dot\theta - \dot\theta_0$ (rad/s)")
    _add_shared_legend(figure, axes)
    return figure


def _sections(
    abdomen: list[Trajectory], known: pd.DataFrame, settings: StabilitySettings
) -> dict[str, dict[str, np.ndarray]]:
    """Return the edges of all sections at t = 0, of the goal set and of its preimage, shape (2, points), by plane and method."""
    sections: dict[str, dict[str, np.ndarray]] = {item.plane: {} for item in abdomen}
    for (plane, method), rows in known.groupby(["plane", "method"]):
        ends = rows.iloc[[0, -1]]
        errors = _ellipses(ends[_COST].to_numpy(), ends["rho"].to_numpy(), _FINE_CIRCLE)
        sections[plane][method] = errors[:, 0]
        if method == "exact":
            # Extent of the funnel relative to the range of each state.
            cost, level = rows[_COST].to_numpy()[:, None], rows[["rho"]].to_numpy()
            extent = Funnels("exact", rows["time_s"].to_numpy()[-1:], cost, level).reach[0]
            times = extent / np.ptp(rows[_REFERENCE].to_numpy(), axis=0)
            sections[plane] |= {"goal": errors[:, 1], "times": times}
    exact = [item for item in abdomen if "exact" in sections[item.plane]]
    # A figure needs fewer knots and no proof.
    fewer = settings.model_copy(update={"knots": settings.fewer_knots, "checks": ()})

    def reaching(items: list[Trajectory]) -> np.ndarray:
        loops = close_loops(items, settings.pendulum.sign, fewer)
        return preimage(loops, np.stack([sections[item.plane]["goal"] for item in items], axis=1))

    def compute(items: list[Trajectory], method: str) -> np.ndarray:
        loops = close_loops(items, settings.pendulum.sign, fewer)
        if method == "best":
            funnels = best_of_family(loops, fewer.goal_level, fewer.lyapunov_shares)
        else:
            funnels = METHODS[method](loops, fewer).funnels
        return _ellipses(funnels.cost[0], funnels.level[0], _FINE_CIRCLE)

    tasks = [("reached", "states that reach the goal", reaching)]
    tasks += [(name, name, partial(compute, method=name)) for name in (*thesis_methods(settings)[1:], "best")]
    for key, title, task in tasks:
        for items, edges in compute_together(task, exact, title, []):
            for index, item in enumerate(items):
                sections[item.plane][key] = edges[:, index]
    return sections


def _draw_sections(axis, sections: dict[str, np.ndarray]) -> None:
    """Draw the sections of one trajectory."""
    grey = {"facecolor": "#00000014", "edgecolor": "#777777", "linewidth": 0.8}
    axis.fill(*sections["reached"], label="all that reach the goal", **grey)
    basins = {name: sections[name] for name in STYLES if name in sections}
    for name, edge in basins.items():
        label, style = STYLES[name]
        axis.plot(*edge, label=label, **style)
    axis.plot(*sections["goal"], color="#777777", linewidth=0.8, linestyle=":", label="goal set (at T)")
    # The preimage may be much larger: the limits are those of the basins.
    x, y = 1.3 * np.abs(np.concatenate([*basins.values()], axis=1)).max(axis=1)
    axis.set(xlim=(-x, x), ylim=(-y, y))
    share = 100 * _enclosed_area(sections["exact"]) / _enclosed_area(sections["reached"])
    angle, velocity = sections["times"]
    text = (
        f"exact: {share:.2g} % of all that reach the goal\n"
        f"reaches {angle:.0f} × as far as $\\theta_0$ ranges, {velocity:.0f} × as $\\dot\\theta_0$"
    )
    white = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    axis.text(0.98, 0.96, text, transform=axis.transAxes, ha="right", va="top", fontsize=6, bbox=white)


def _enclosed_area(edge: np.ndarray) -> float:
    """Return the area inside a closed curve, shape (2, points), by the shoelace formula."""
    x, y = edge
    return 0.5 * abs(float(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))
