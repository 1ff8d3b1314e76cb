"""Where a model fails: nine views of its error on one page."""

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
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import SIGNIFICANT_Z, no_cell_stands_out
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual, View, percent
from lumbar.tissue.diagnosis.residuals.residual_tests import EVEN_FUNCTIONS, LINEAR_FUNCTIONS
from lumbar.tissue.diagnosis.residuals.time_frequency import ABOVE, BELOW, BETWEEN, EVEN, EXCITED, ODD

_LINES = {
    EXCITED: {"marker": "o", "color": SERIES[0], "label": "excited"},
    EVEN: {"marker": "s", "color": SERIES[3], "label": "even"},
    ODD: {"marker": "^", "color": SERIES[2], "label": "odd, left out"},
    BETWEEN: {"marker": "o", "color": SERIES[0], "label": "in the input's band"},
    ABOVE: {"marker": "^", "color": SERIES[3], "label": "above the band"},
    BELOW: {"marker": "s", "color": SERIES[2], "label": "below"},
}
_STYLES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_BAND = {"color": "#cccccc", "linewidth": 0}
_SHORT = {"position and velocity": "map"}
_ODD_CURVES = 2
"""Odd functions of the input whose correlations are drawn beside the linear ones: the most related."""


@house_style
def location_figure(location: Location) -> Figure:
    """Draw the views of a location, row by row: when and how fast, where in the motion, related to what.

    Time, cycles of the motion, spectrum; depth, reversals, position and velocity; autocorrelation, correlation with
    the input and odd functions of it, with even functions of it. Grey bands are 95 % limits under noise alone.
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 6.6, nrows=3, ncols=3)
    views, residual = location.views, location.residual
    (time, cycles, spectrum), (depth, turning, plane), (whiteness, odd, even) = axes
    _draw_time(time, views["time"], location)
    _draw_cycles(cycles, views["cycles"], location)
    _draw_spectrum(spectrum, views["frequency"], unit_in_print(residual.unit))
    _draw_map(figure, plane, views["position and velocity"], location)
    _draw_depth(depth, views["depth"], location)
    _draw_reversals(turning, views["reversals"], unit_in_print(residual.unit))
    _draw_whiteness(whiteness, views["whiteness"])
    correlations = views["correlations"]
    _draw_correlations(odd, correlations, [*LINEAR_FUNCTIONS, *_strongest_odd(correlations)])
    _draw_correlations(even, correlations, EVEN_FUNCTIONS)
    even.set(ylabel="… with even functions", ylim=odd.get_ylim())
    label_panels(axes.ravel())
    for name, axis in (
        ("time", time),
        ("position and velocity", plane),
        ("depth", depth),
        ("reversals", turning),
    ):
        axis.set_title(_with_share(views[name], residual), loc="right", fontsize=7)
    unit = unit_in_print(residual.unit)
    floor = "noise unknown" if residual.floor is None else f"noise {residual.floor.rms:.3g} {unit}"
    figure.suptitle(
        f"{location.record.replace('_', ' ')}: error {np.sqrt(residual.variance):.3g} {unit} RMS, {floor}",
        fontsize=8,
    )
    return figure


def _with_share(view: View, residual: Residual) -> str:
    """What a panel says of the error: its share, or that it says nothing; that is no word about the error's size."""
    name = _SHORT.get(view.name, view.name)
    if view.p_value < SIGNIFICANT:
        whole = ", as a whole" if no_cell_stands_out(view) else ""
        return f"{name}: {percent(view.share)}{whole}"
    repeats = view.name == "time" and residual.folding is not None
    return f"{name}: all repeats" if repeats else f"{name}: no relation"


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
    _room_for_legend(axis, 0.3, ncols=2)


def _room_for_legend(axis, share: float, **legend) -> None:
    head_room(axis, share)
    axis.legend(loc="upper center", handlelength=1.6, columnspacing=1.0, handletextpad=0.5, **legend)


def _draw_cycles(axis, view: View, location: Location) -> None:
    table, residual = view.table, location.residual
    axis.set_xlabel(f"Amplitude of the cycle ({residual.position_unit})")
    axis.set_ylabel(f"Error in the cycle ({unit_in_print(residual.unit)} RMS)")
    if not len(table["rms"]):
        axis.annotate("too few cycles", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    rings = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markeredgewidth": 0.5}
    axis.plot(table["amplitude"], table["rms"], markersize=2, color=SERIES[0], **rings)
    if residual.floor is not None:
        mark_noise_floor(axis, residual.floor.rms)
        _room_for_legend(axis, 0.15)
    axis.set_xlim(left=0)
    axis.set_ylim(bottom=0)


def _draw_spectrum(axis, view: View, unit: str) -> None:
    table = view.table
    positive = table["frequency"] > 0
    # Bands differ in width: density makes them comparable. Lines stand for themselves.
    scale = np.sqrt(table["width"]) if "width" in table else np.ones(len(positive))
    error, noise = table["rms"] / scale, table["noise_rms"] / scale
    for kind, look in _LINES.items():
        chosen = positive & (table["kind"] == kind)
        if chosen.any():
            axis.plot(
                table["frequency"][chosen],
                error[chosen],
                linestyle="none",
                markersize=2.4,
                markerfacecolor="none" if kind in (EVEN, ABOVE) else look["color"],
                markeredgewidth=0.6,
                **look,
            )
    if table["noise_rms"].any():
        dashed = {"color": "black", "linestyle": "--", "linewidth": 0.8}
        axis.plot(table["frequency"][positive], noise[positive], label="noise", **dashed)
    axis.set(xscale="log", yscale="log")
    largest = error[positive].max()
    smallest = max(np.quantile(error[positive], 0.02), 1e-6 * largest)
    if noise[positive].any():
        smallest = min(smallest, 0.8 * float(np.median(noise[positive])))
    axis.set(ylim=(0.5 * smallest, largest * (largest / smallest) ** 0.35 * 1.5), xlabel="Frequency (Hz)")
    axis.set_ylabel(f"Error ({unit}/√Hz)" if "width" in table else f"Error in each line ({unit} RMS)")
    axis.legend(loc="upper center", ncols=2, handletextpad=0.2, columnspacing=0.8, borderpad=0.2)


def _draw_map(figure, axis, view: View, location: Location) -> None:
    table, residual = view.table, location.residual
    columns = np.append(np.unique(table["position_low"]), table["position_high"].max())
    rows = np.append(np.unique(table["velocity_low"]), table["velocity_high"].max())
    mean = table["mean"].reshape(len(rows) - 1, len(columns) - 1)
    seen = mean[np.isfinite(mean)] if np.any(np.isfinite(mean)) else np.zeros(1)
    low, high = float(seen.min()), float(seen.max())
    if low < 0 < high:
        low, high = -max(-low, high), max(-low, high)
    # One lightness per value: the sign of the error can be read in grey.
    image = axis.pcolormesh(
        columns, rows, mean, cmap="cividis", vmin=low, vmax=high, edgecolor="white", linewidth=0.2
    )
    chance = np.abs(table["z_score"].reshape(mean.shape)) < SIGNIFICANT_Z
    if view.p_value < SIGNIFICANT and no_cell_stands_out(view):
        chance[:] = False  # the pattern is none of chance, though each of its cells alone may be
    row, column = np.nonzero(chance)
    if len(row):
        crosses = {"linestyle": "none", "marker": "x", "markersize": 2.5, "markeredgewidth": 0.6}
        across, up = (columns[column] + columns[column + 1]) / 2, (rows[row] + rows[row + 1]) / 2
        axis.plot(across, up, color="white", **crosses)
    axis.axhline(0, color="white", linewidth=0.8)
    axis.grid(visible=False)
    axis.set_xlabel(f"{residual.moved.capitalize()} ({residual.position_unit})")
    axis.set_ylabel(f"Velocity ({residual.position_unit}/s)")
    bar = figure.colorbar(
        image, ax=axis, label=f"Mean error ({unit_in_print(residual.unit)}); ×: chance", pad=0.02
    )
    bar.outline.set_visible(False)


def _draw_depth(axis, view: View, location: Location) -> None:
    table, residual = view.table, location.residual
    limit = 1.96 * table["deviation"]
    axis.fill_between(table["position"], -limit, limit, **_BAND)
    axis.plot(table["position"], table["mean"], color="black", linewidth=1.3, label="all")
    for name, color, marker, line in (
        ("advancing", SERIES[0], "^", _STYLES[1]),
        ("retracting", SERIES[3], "v", _STYLES[2]),
    ):
        look = {"color": color, "marker": marker, "markersize": 2.5, "linestyle": line, "linewidth": 0.9}
        axis.plot(table["position"], table[name], label=name, **look)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set_xlabel(f"{residual.moved.capitalize()} ({residual.position_unit})")
    axis.set_ylabel(f"Mean error ({unit_in_print(residual.unit)})")
    _room_for_legend(axis, 0.3, ncols=2)


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


def _draw_whiteness(axis, view: View) -> None:
    table = view.table
    limit = table["limit"][0]
    axis.axhspan(-limit, limit, **_BAND)
    axis.vlines(table["lag"], 0, table["correlation"], color=SERIES[0], linewidth=1.0)
    axis.plot(
        table["lag"], table["correlation"], linestyle="none", marker="o", markersize=2.2, color=SERIES[0]
    )
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set(xlabel="Lag (s)", ylabel="Autocorrelation of the error")
    verdict = "not white" if view.p_value < SIGNIFICANT else "as noise"
    axis.set_title(f"whiteness: {verdict}", loc="right", fontsize=7)


def _strongest_odd(view: View) -> list[str]:
    """Odd functions of the input that the error is most related to."""
    table = view.table
    names = [
        name for name in dict.fromkeys(table["function"]) if name not in (*LINEAR_FUNCTIONS, *EVEN_FUNCTIONS)
    ]
    strength = {name: np.abs(table["correlation"][table["function"] == name]).max() for name in names}
    return sorted(names, key=lambda name: -strength[name])[:_ODD_CURVES]


def _draw_correlations(axis, view: View, shown) -> None:
    table = view.table
    limit = max(table["limit"][table["function"] == name][0] for name in shown)
    axis.axhspan(-limit, limit, **_BAND)
    for name, color, line in zip(shown, SERIES, _STYLES, strict=False):
        mine = table["function"] == name
        look = {"color": color, "linestyle": line, "linewidth": 1.1}
        axis.plot(table["lag"][mine], table["correlation"][mine], label=f"with {name}", **look)
    axis.axhline(0, color="black", linewidth=0.5)
    axis.set(xlabel="Lag behind the input (s)", ylabel="Correlation of the error …")
    _room_for_legend(axis, 0.35, ncols=2)
