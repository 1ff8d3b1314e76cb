"""Pushes: ROC of the measures, and perturbed trials in the plane of the pendulum's states."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lumbar.lifting.measures.registry import measure_in_words
from lumbar.lifting.pushes.chances import KNOWN
from lumbar.lifting.pushes.levels import BACKWARD, FORWARD
from lumbar.lifting.pushes.prediction import ALL_SIZES, BOTH, EQUAL, pushes_of, scores_of
from lumbar.lifting.pushes.roc import curve
from lumbar.lifting.stability.comparison.perturbed_trials import (
    PHASE_POINTS,
    Trial,
    funnels_of,
    mean_trajectory,
    references,
    values_of,
)
from lumbar.publishing.figures.palette import MEASURED, SEGMENTS, SERIES
from lumbar.publishing.figures.stability_figures import ellipses
from lumbar.publishing.figures.style import DOUBLE_COLUMN, house_style, new_figure
from lumbar.settings.pushes import PerturbationsSettings
from lumbar.settings.stability import StabilitySettings

PANELS = (
    (ALL_SIZES, BOTH, "All sizes, both directions"),
    (EQUAL, FORWARD, "Equal pushes forward"),
    (EQUAL, BACKWARD, "Equal pushes backward"),
)
DRAWN = (
    *("viability_margin", "capture_margin", "margin_of_stability", "trunk_inclination", "l5s1_moment"),
    *("basin_abdomen_inverted", "basin_area_abdomen_hanging", KNOWN),
)
"""Measures that a picture can hold; all stand in the table. The smallest impulse lies on the margin of stability's curve."""
POINTS = 1000
"""Of a curve at most: those of a thousand lifters would have a point for each of 70,000 pushes."""
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "")
_STYLES = (
    "-",
    (0, (6, 1.5)),
    (0, (2, 1)),
    (0, (1, 1)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 3)),
)


@house_style
def push_figure(frame: pd.DataFrame, table: pd.DataFrame, told: Mapping) -> Figure:
    """Draw the curves of some measures in three panels; below them what each adds, and areas, with intervals.

    Parameters
    ----------
    frame : pandas.DataFrame
        Pushes, columns `lumbar.lifting.pushes.contest.COLUMNS`.
    table : pandas.DataFrame
        Of `lumbar.lifting.pushes.prediction.prediction_frame`.
    told : mapping
        Log odds of `lumbar.lifting.pushes.prediction.chances`.
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 4.6, nrows=2, ncols=len(PANELS), sharey="row", gridspec_kw={"height_ratios": [1.5, 1]}
    )
    for column, (contest, direction, title) in enumerate(PANELS):
        rows = table[(table["contest"] == contest) & (table["direction"] == direction)].set_index("measure")
        here = pushes_of(frame, direction)
        drawn = [name for name in DRAWN if name in rows.index]
        _curves(
            axes[0, column],
            {name: [item[here] for item in scores_of(frame, name, contest, told)] for name in drawn},
        )
        if contest == EQUAL:
            _values(axes[1, column], rows, "auc", 0.5)
            axes[1, column].set(xlim=(-0.03, 1.03), xticks=[0.0, 0.5, 1.0], xlabel="Area under the curve")
        else:
            _values(axes[1, column], rows, "increment", 0.0)
            axes[1, column].set(xlabel="Area added to " + KNOWN.replace("_", " "))
        axes[0, column].set_title(title)
    axes[0, 0].set_ylabel("Told of those who step")
    return figure


def _look(number: int) -> dict:
    """Colour and line style of a measure; the baseline is thin and grey."""
    if DRAWN[number] == KNOWN:
        return {"color": "#888888", "linestyle": "-", "linewidth": 0.9}
    return {"color": SERIES[number % len(SERIES)], "linestyle": _STYLES[number % len(_STYLES)]}


def _curves(axis, scores: Mapping) -> None:
    axis.plot([0, 1], [0, 1], color="#bbbbbb", linewidth=0.8, zorder=0)
    for number, name in enumerate(DRAWN):
        if name in scores:
            alarms, hits = curve(*scores[name])
            shown = np.unique(np.linspace(0, len(alarms) - 1, POINTS).astype(int))
            alarms, hits = alarms[shown], hits[shown]
            last = max(1, len(alarms) // 6)
            marks = {"marker": _MARKERS[number], "markersize": 3, "markevery": (number, last)}
            axis.plot(alarms, hits, **marks, **_look(number))
    axis.set(xlabel="Told of those who stand", aspect="equal")


def _values(axis, rows: pd.DataFrame, column: str, nothing: float) -> None:
    """Values of a column with their intervals, one line per measure; `nothing` is what says nothing."""
    axis.axvline(nothing, color="#bbbbbb", linewidth=0.8, zorder=0)
    names = [name for name in DRAWN if name != KNOWN]
    for number, name in enumerate(names):
        if name not in rows.index:
            continue
        row, colour = rows.loc[name], _look(number)["color"]
        axis.plot(
            row[[f"{column}_low", f"{column}_high"]].astype(float), [number] * 2, color=colour, linewidth=1.2
        )
        axis.plot(row[column], number, marker=_MARKERS[number] or "|", color=colour, markersize=4.5)
    axis.set_yticks(range(len(names)), [measure_in_words(name) for name in names])
    axis.set(ylim=(len(names) - 0.5, -0.5))


COLOURS = {"unperturbed": SEGMENTS["thorax"], "perturbed": SEGMENTS["pelvis"]}
_CIRCLE = np.linspace(0.0, 2 * np.pi, 121)


@house_style
def trials_figure(
    trials: list[Trial],
    by_weight: pd.DataFrame,
    settings: PerturbationsSettings,
    stability: StabilitySettings,
) -> Figure:
    """Draw sections of the basin with all trials, V/ρ of every trial over phase, and how many lie inside by R and sign."""
    unperturbed = [trial for trial in trials if trial.group == "unperturbed"]
    mean = mean_trajectory(unperturbed, settings)
    funnel = funnels_of([mean], stability.pendulum.sign, stability)[0]
    figure, (plane, values, counts) = new_figure(DOUBLE_COLUMN, 3.0, ncols=3)
    angles, velocities = ellipses(funnel.cost[:, 0], funnel.level[:, 0], _CIRCLE)
    for knot in np.linspace(0, PHASE_POINTS - 1, 12).round().astype(int):
        angle = mean.angle[knot] + angles[knot]
        velocity = mean.angular_velocity[knot] + velocities[knot]
        look = {"facecolor": "#00000010", "edgecolor": "#555555", "linewidth": 0.5}
        plane.fill(angle, velocity, label="basin of the mean" if knot == 0 else None, **look)
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
    plane.set(xlabel="θ (rad)", ylabel=r"$\dot\theta$ (rad/s)")
    values.axhline(1.0, color=MEASURED, linewidth=1.0)
    values.set_yscale("log")
    values.set_ylim(bottom=1e-2)
    values.set(xlabel="Phase (%)", ylabel="V/ρ (inside: ≤ 1; cut at 0.01)")
    _draw_counts(counts, by_weight, stability)
    figure.legend(*plane.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw_counts(axis, by_weight: pd.DataFrame, stability: StabilitySettings) -> None:
    """Draw how many trials lie inside throughout over the control weight; the study's is marked."""
    for (sign, group), rows in by_weight.groupby(["sign", "group"], sort=False):
        colour, marker = COLOURS[group], "o" if group == "unperturbed" else "s"
        look = {"linestyle": (0, (3, 2)), "markersize": 3, "markerfacecolor": "white"}
        if sign == "inverted":
            look = {"linestyle": "-", "markersize": 4, "markerfacecolor": colour}
        label = f"{group}, {sign}"
        axis.plot(rows["control_weight"], rows["inside"], color=colour, marker=marker, label=label, **look)
    axis.set_xscale("log")
    # Room above the counts for the legend.
    most = int(by_weight["inside"].max())
    axis.vlines(stability.regulator.control_weight, -0.4, most, color="#777777", linewidth=0.8, linestyle=":")
    axis.set(
        ylim=(-0.4, 1.7 * max(most, 1)),
        yticks=range(most + 1),
        xlabel="R (1/(N²·m²·s))",
        ylabel="Trials inside throughout",
    )
    axis.legend(fontsize=5.5, loc="upper center")
