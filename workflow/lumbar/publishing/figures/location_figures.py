"""Figures of a model's error on records of one or several axes: over time, depth and reversals, in space, by direction."""

from itertools import combinations, pairwise

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lumbar.base.formats import format_number
from lumbar.publishing.figures.comparison_figures import default_segment, draw_segment
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    SERIES,
    add_head_room,
    house_style,
    label_panels,
    mark_noise_floor,
    new_figure,
)
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.diagnosis.residuals.locate import Location
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual, percent
from lumbar.tissue.diagnosis.spatial.location_in_space import BANDS, TURNS, SpatialResidual, directions
from lumbar.tissue.diagnosis.spatial.spatial_reports import SpatialReport

_BAND_STYLE = {"color": "#cccccc", "linewidth": 0}
_ON_WHITE = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.6}
_STEPS = 4
"""Number of straight steps in which a cell's bent edge is drawn."""
_MAX_PIECES = 600
"""Largest number of drawn pieces of the path."""
_SIZE_COLOURS, _SIGNED = "cividis_r", "cividis"
"""Colour maps that are readable in grey: `_SIZE_COLOURS` for sizes (the largest is the darkest), `_SIGNED` for signed values."""


@house_style
def location_figure(location: Location) -> Figure:
    """Draw the error of a location over time, over depth and around reversals, with the 95 % limits of pure noise in grey."""
    figure, axes = new_figure(DOUBLE_COLUMN, 2.6, ncols=3)
    views, residual = location.views, location.residual
    unit = unit_in_print(residual.unit)
    _draw_time(axes[0], views["time"].table, residual)
    _draw_depth(axes[1], views["position and velocity"].table, residual)
    _draw_reversals(axes[2], views["reversals"].table, unit)
    label_panels(axes)
    for name, axis in zip(("time", "depth", "reversals"), axes, strict=True):
        # The title is the share, or "no relation"; the error's size is not in it.
        title = percent(location.shares[name])
        if location.p_values[name] >= SIGNIFICANT:
            title = "all repeats" if name == "time" and residual.folding is not None else "no relation"
        axis.set_title(f"{name}: {title}", loc="right", fontsize=7)
    floor = "noise unknown" if residual.floor is None else f"noise {residual.floor.rms:.3g} {unit}"
    error = f"error {np.sqrt(residual.variance):.3g} {unit} RMS"
    figure.suptitle(f"{location.record.replace('_', ' ')}: {error}, {floor}", fontsize=8)
    return figure


def _draw_time(axis, table: dict[str, np.ndarray], residual: Residual) -> None:
    middle = (table["start"] + table["stop"]) / 2
    edges = np.append(table["start"], table["stop"][-1])
    axis.stairs(table["rms"], edges, baseline=None, color=SERIES[0], linewidth=1.2, label="RMS")
    bars = {"fmt": "s", "markersize": 3, "color": SERIES[3], "linewidth": 0.8, "capsize": 1.5}
    axis.errorbar(middle, table["mean"], 1.96 * table["deviation"], label="mean", **bars)
    if residual.floor is not None:
        mark_noise_floor(axis, residual.floor.rms)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set(xlabel="Time (s)", ylabel=f"Error ({unit_in_print(residual.unit)})")
    _room_for_legend(axis)


def _room_for_legend(axis) -> None:
    add_head_room(axis, 0.3)
    axis.legend(loc="upper center", handlelength=1.6, columnspacing=1.0, handletextpad=0.5, ncols=2)


def _draw_depth(axis, table: dict[str, np.ndarray], residual: Residual) -> None:
    limit = 1.96 * table["deviation"]
    axis.fill_between(table["position"], -limit, limit, **_BAND_STYLE)
    axis.plot(table["position"], table["mean"], color="black", linewidth=1.3, label="all")
    for name, color, marker, line in (
        ("advancing", SERIES[0], "^", (0, (5, 1.5))),
        ("retracting", SERIES[3], "v", (0, (1, 1))),
    ):
        look = {"color": color, "marker": marker, "markersize": 2.5, "linestyle": line, "linewidth": 0.9}
        axis.plot(table["position"], table[name], label=name, **look)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set_xlabel(f"{residual.moved.capitalize()} ({residual.position_unit})")
    axis.set_ylabel(f"Mean error ({unit_in_print(residual.unit)})")
    _room_for_legend(axis)


def _draw_reversals(axis, table: dict[str, np.ndarray], unit: str) -> None:
    axis.set(xlabel="Time since reversal (s)", ylabel=f"Mean error × new direction ({unit})")
    if not len(table["time"]):
        axis.annotate("too few reversals", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    limit = 1.96 * table["deviation"]
    axis.fill_between(table["time"], -limit, limit, **_BAND_STYLE)
    axis.plot(table["time"], table["mean"], color=SERIES[0], marker="o", markersize=2.5)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.axvline(0, color="black", linestyle="--", linewidth=0.8)
    axis.locator_params(axis="x", nbins=4)


@house_style
def spatial_comparison_figure(report: SpatialReport, model: str) -> Figure:
    """Draw measured and simulated force along every axis over a typical segment of a record, and the residual.

    `report` is the comparison on one record, `model` the name in the legend.
    """
    widest = max(report.axes, key=lambda item: item.comparison.rms.value)
    segment = default_segment(widest.record, widest.values, widest.comparison.start)
    count = len(report.axes)
    size = {"nrows": count, "ncols": 2, "sharex": True, "width_ratios": (1.25, 1)}
    figure, axes = new_figure(DOUBLE_COLUMN, 0.7 + 1.5 * count, **size)
    for row, item in zip(axes, report.axes, strict=True):
        draw_segment(row, item.record, item.values, item.comparison, segment, model)
        output, axis = item.record.channels["output"], item.record.name[-2]  # x of "multisine (x)"
        row[0].set_ylabel(f"{output.quantity.capitalize()} {axis} ({unit_in_print(output.unit)})")
        row[0].set_title(f"VAF {format_number(item.comparison.vaf.value, 4)} %", loc="right")
    for axis in axes[:-1, 1]:
        axis.set_xlabel("")
    sizes = [float(np.abs(axis.lines[0].get_ydata()).max()) for axis in axes[:, 1]]
    sizes += [2 * item.comparison.floor.rms for item in report.axes if item.comparison.floor]
    for axis in axes[:, 1]:
        axis.set_ylim(-1.1 * max(sizes), 1.1 * max(sizes))
        if axis.get_legend():
            axis.get_legend().remove()
    handles = [pair for axis in axes[0] for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
    figure.legend(*zip(*handles, strict=True), loc="outside upper center", ncols=3)
    axes[-1, 0].set_xlabel("Time (s)")
    axes[0, 0].set_xlim(segment)
    return figure


@house_style
def spatial_location_figure(report: SpatialReport) -> Figure:
    """Draw the path, coloured by the error, in views along every axis, and the error over the direction of travel."""
    residual, view = report.residual, report.views["direction of travel"].table
    names, unit = residual.axes, unit_in_print(report.residual.unit)
    pairs = list(combinations(range(len(names)), 2))
    figure = new_figure(DOUBLE_COLUMN, 4.9)[0]
    figure.clear()
    above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1))
    panels = np.atleast_1d(above.subplots(1, len(pairs)))
    lines = [_draw_path(panel, residual, pair) for panel, pair in zip(panels, pairs, strict=True)]
    above.colorbar(lines[0], ax=panels.tolist(), label=f"Error ({unit} RMS)", shrink=0.9)
    mean = np.stack([view[f"mean_{name}"] for name in names], axis=1)
    along = np.sum(mean * directions(len(names)), axis=1)
    bound = float(np.nanmax(np.abs(along), initial=0.0)) or 1.0
    largest = float(np.nanmax(view["rms"], initial=0.0)) or 1.0
    drawn = (
        ("Error by direction of travel", f"Error ({unit} RMS)", view["rms"], _SIZE_COLOURS, 0.0, largest),
        ("Mean error along the travel", f"Mean ({unit})", along, _SIGNED, -bound, bound),
    )
    draw, projection = (_draw_sphere, "mollweide") if len(names) == 3 else (_draw_circle, "polar")
    maps = below.subplots(1, 2, subplot_kw={"projection": projection})
    for panel, (title, label, values, colours, low, high) in zip(maps, drawn, strict=True):
        cells = draw(panel, values, names, cmap=colours, vmin=low, vmax=high)
        panel.set_title(title)
        below.colorbar(cells, ax=panel, label=label, shrink=0.75)
    return figure


def _draw_path(panel, residual: SpatialResidual, pair: tuple[int, int]) -> LineCollection:
    """Draw one projection of the path; for a record that repeats, only the last period, with the error of all periods."""
    shown, square = np.arange(residual.samples), np.sum(residual.values**2, axis=0)
    folding = residual.parts[0].folding
    if folding is not None:
        shown, square = folding.rows[-1], folding.fold(square).mean(axis=0)
    position = np.stack([residual.parts[axis].position[shown] for axis in pair], axis=1)
    bounds = list(pairwise(np.unique(np.linspace(0, len(shown) - 1, _MAX_PIECES + 1).astype(int))))
    pieces = [position[first : last + 1] for first, last in bounds]
    error = np.sqrt([square[first : last + 1].mean() for first, last in bounds])
    largest = float(error.max()) or 1.0
    order = np.argsort(error, kind="stable")
    lines = LineCollection(
        [pieces[index] for index in order],
        array=error[order],
        cmap=_SIZE_COLOURS,
        clim=(0.0, largest),
        linewidths=0.5 + 2.0 * error[order] / largest,
        capstyle="round",
    )
    panel.add_collection(lines)
    panel.autoscale()
    panel.set_aspect("equal", adjustable="datalim" if len(residual.axes) > 2 else "box")
    unit = unit_in_print(residual.parts[0].position_unit)
    name = residual.parts[0].moved.capitalize()
    one, other = (residual.axes[axis] for axis in pair)
    panel.set(xlabel=f"{name} {one} ({unit})", ylabel=f"{name} {other} ({unit})")
    return lines


def _draw_sphere(panel, values: np.ndarray, axes: tuple[str, ...], **look):
    """Draw an equal-area map of the sphere: the last axis points up, the first axis is in the middle."""
    turn = np.linspace(-np.pi, np.pi, TURNS + 1)
    height = np.arcsin(np.linspace(-1, 1, BANDS * _STEPS + 1))
    shown = np.ma.masked_invalid(np.repeat(values.reshape(BANDS, TURNS), _STEPS, axis=0))
    cells = panel.pcolormesh(turn, height, shown, edgecolors="face", linewidth=0.2, **look)
    panel.set(xticks=[], yticks=[])
    quarter = np.pi / 2
    places = ((-quarter, 0), (0, 0), (quarter, 0), (0, 0.85 * quarter), (0, -0.85 * quarter))
    first, second, third = axes
    for place, name in zip(
        places, (f"−{second}", f"+{first}", f"+{second}", f"+{third}", f"−{third}"), strict=True
    ):
        panel.text(*place, name, ha="center", va="center", size=7, bbox=_ON_WHITE)
    panel.grid(visible=False)
    return cells


def _draw_circle(panel, values: np.ndarray, axes: tuple[str, ...], **look):
    """Draw a ring of the plane's directions."""
    turn = np.linspace(0, 2 * np.pi, len(values) + 1)
    cells = panel.pcolormesh(turn, [0.55, 1.0], np.ma.masked_invalid(values[None]), **look)
    first, second = axes
    panel.set_xticks(np.arange(4) * np.pi / 2, [f"+{first}", f"+{second}", f"−{first}", f"−{second}"])
    panel.set(yticks=[], ylim=(0, 1))
    panel.grid(visible=False)
    return cells
