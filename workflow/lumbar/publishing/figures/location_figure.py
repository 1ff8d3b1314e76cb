"""Where a model fails: its error over time, over depth and around reversals."""

import numpy as np
from matplotlib.figure import Figure

from lumbar.publishing.figures.palette import SERIES
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    head_room,
    house_style,
    label_panels,
    mark_noise_floor,
    new_figure,
)
from lumbar.tables.layout import unit_in_print
from lumbar.tissue.diagnosis.residuals.locate import Location
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, View, percent

_BAND = {"color": "#cccccc", "linewidth": 0}


@house_style
def location_figure(location: Location) -> Figure:
    """Draw the error of a location over time, over depth and around reversals; grey: 95 % limits of noise alone."""
    figure, axes = new_figure(DOUBLE_COLUMN, 2.6, ncols=3)
    views, residual = location.views, location.residual
    time, depth, turning = axes
    _draw_time(time, views["time"], location)
    _draw_depth(depth, views["position and velocity"], location)
    _draw_reversals(turning, views["reversals"], unit_in_print(residual.unit))
    label_panels(axes)
    for name, axis in (("time", time), ("depth", depth), ("reversals", turning)):
        # The title gives the share, or that there is no relation; it says nothing about the error's size.
        title = percent(location.shares[name])
        if location.p_values[name] >= SIGNIFICANT:
            title = "all repeats" if name == "time" and residual.folding is not None else "no relation"
        axis.set_title(f"{name}: {title}", loc="right", fontsize=7)
    unit = unit_in_print(residual.unit)
    floor = "noise unknown" if residual.floor is None else f"noise {residual.floor.rms:.3g} {unit}"
    figure.suptitle(
        f"{location.record.replace('_', ' ')}: error {np.sqrt(residual.variance):.3g} {unit} RMS, {floor}",
        fontsize=8,
    )
    return figure


def _draw_time(axis, view: View, location: Location) -> None:
    table, residual = view.table, location.residual
    middle = (table["start"] + table["stop"]) / 2
    edges = np.append(table["start"], table["stop"][-1])
    axis.stairs(table["rms"], edges, color=SERIES[0], linewidth=1.2, label="RMS")
    bars = {"fmt": "s", "markersize": 3, "color": SERIES[3], "linewidth": 0.8, "capsize": 1.5}
    axis.errorbar(middle, table["mean"], 1.96 * table["deviation"], label="mean", **bars)
    if residual.floor is not None:
        mark_noise_floor(axis, residual.floor.rms)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set(xlabel="Time (s)", ylabel=f"Error ({unit_in_print(residual.unit)})")
    _room_for_legend(axis)


def _room_for_legend(axis) -> None:
    head_room(axis, 0.3)
    axis.legend(loc="upper center", handlelength=1.6, columnspacing=1.0, handletextpad=0.5, ncols=2)


def _draw_depth(axis, view: View, location: Location) -> None:
    table, residual = view.table, location.residual
    limit = 1.96 * table["deviation"]
    axis.fill_between(table["position"], -limit, limit, **_BAND)
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


def _draw_reversals(axis, view: View, unit: str) -> None:
    table = view.table
    axis.set(xlabel="Time since reversal (s)", ylabel=f"Mean error × new direction ({unit})")
    if not len(table["time"]):
        axis.annotate("too few reversals", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    limit = 1.96 * table["deviation"]
    axis.fill_between(table["time"], -limit, limit, **_BAND)
    axis.plot(table["time"], table["mean"], color=SERIES[0], marker="o", markersize=2.5)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.axvline(0, color="black", linestyle="--", linewidth=0.8)
    axis.locator_params(axis="x", nbins=4)
