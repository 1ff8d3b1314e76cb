"""Figures of measures over a lift, the base of support from above, and the quality of every marker over time."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lumbar.base.templates import typeset_minus_signs
from lumbar.lifting.measures.balance import corners_around
from lumbar.lifting.measures.course import CORNERS, base_from_course
from lumbar.lifting.quality.implausible_motion import LABORATORY_M
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.lifting.quality.screening import QualitySheet
from lumbar.publishing.figures.lifting_figures import EVENT_LABELS
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SERIES,
    house_style,
    new_figure,
    note,
    show_placeholder,
)
from lumbar.records.sampling import runs

MAX_LIFTS = 4
"""Largest number of lifts in a figure: the first lifts are drawn."""
_LINES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1, 1, 1)))
_GREY, _LIGHT = "#888888", "#cccccc"
_PLACEHOLDER = {"va": "center", "color": _GREY, "wrap": True}
_WHITE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}
MARGIN_MM = (-120.0, 170.0)
"""Drawn range of the margin in mm: during walking the extrapolated centre leaves the base at every step."""


def _person_looks(lifts: list[dict]) -> dict[str, dict]:
    """Return colour and line style of every person, in their order."""
    people = dict.fromkeys(lift["facts"]["subject"] for lift in lifts)
    return {
        name: {"color": SERIES[number % len(SERIES)], "linestyle": _LINES[number % len(_LINES)]}
        for number, name in enumerate(people)
    }


def _title(lift: dict) -> str:
    return f"{lift['facts']['subject']}, {lift['facts']['box_mass_kg']:g} kg"


@house_style
def course_figure(lifts: list[dict], functional_share: float) -> Figure:
    """Draw the margin of stability and the moment about L5/S1 from lift-off to a little after the release.

    Only the first `MAX_LIFTS` lifts are drawn. Each has ``course`` (data frame of
    `lumbar.lifting.measures.course.course_of_lift`), ``facts`` and ``events``; `functional_share` is the functional share of
    the base of support.
    """
    looks, shown = _person_looks(lifts), lifts[:MAX_LIFTS]
    size = {"nrows": 2, "ncols": len(shown), "squeeze": False}
    figure, axes = new_figure(DOUBLE_COLUMN, 3.8, sharex="col", sharey="row", **size)
    low, high = MARGIN_MM
    is_cut = False
    for column, lift in zip(axes.T, shown, strict=True):
        course, look = lift["course"], looks[lift["facts"]["subject"]]
        column[0].set_title(_title(lift))
        for axis, name, factor in zip(
            column, ("margin_of_stability_m", "l5s1_moment_N_m"), (1e3, 1.0), strict=True
        ):
            if name in course:
                axis.plot(course["time_s"], factor * course[name], **look)
            else:
                show_placeholder(axis, "no markers for it", **_PLACEHOLDER)
        column[0].axhline(0.0, color="black", linewidth=0.8)
        column[1].set_xlabel("Time (s)")
        _mark_events(column, lift)
        margin = 1e3 * course.get("margin_of_stability_m", pd.Series(0.0, course.index))
        is_cut |= not low <= margin.min() <= margin.max() <= high
    axes[0, 0].set(ylim=MARGIN_MM, ylabel=f"Margin of stability (mm)\nto {functional_share:.0%} of the base")
    axes[1, 0].set_ylim(bottom=0)
    axes[1, 0].set_ylabel("Moment about L5/S1 (N·m)")
    if is_cut:
        figure.supxlabel(f"Margins beyond −{-low:g} and {high:g} mm are cut off.", fontsize=6)
    if len(lifts) > MAX_LIFTS:
        figure.suptitle(f"the first {MAX_LIFTS} of {len(lifts)} lifts", fontsize=7, color=_GREY)
    return figure


def _mark_events(axes, lift: dict) -> None:
    times = {name: event["time_s"] for name, event in lift["events"].items() if event["time_s"] is not None}
    for axis in axes:
        for time in times.values():
            axis.axvline(time, color=_GREY, linewidth=0.7, linestyle=(0, (1, 2)), zorder=0)
        if "deposit_start" in times and "release" in times:
            axis.axvspan(times["deposit_start"], times["release"], color="#eeeeee", zorder=-1)
    look = {"rotation": 90, "ha": "right", "va": "top", "fontsize": 5.5, "color": _GREY}
    for name, time in times.items():
        axes[0].annotate(EVENT_LABELS[name], (time, 0.98), xycoords=axes[0].get_xaxis_transform(), **look)
    if times:
        axes[0].set_xlim(min(times.values()) - 0.4, max(times.values()) + 0.6)


@house_style
def support_figure(lifts: list[dict], functional_share: float) -> Figure:
    """Draw the feet, the base of support and the path of the extrapolated centre during the deposit, seen from above.

    For `lifts` and `functional_share` see `course_figure`.
    """
    looks, shown = _person_looks(lifts), lifts[:MAX_LIFTS]
    figure, axes = new_figure(DOUBLE_COLUMN, 2.6, ncols=len(shown), sharex=True, sharey=True, squeeze=False)
    for axis, lift in zip(axes[0], shown, strict=True):
        axis.set(title=_title(lift), aspect="equal")
        course = lift["course"]
        deposit = course[course["phase"] == "deposit"]
        if "margin_of_stability_m" not in course or deposit["margin_of_stability_m"].isna().all():
            show_placeholder(axis, "no base of support during a deposit", **_PLACEHOLDER)
            continue
        _draw_support(axis, deposit, functional_share, looks[lift["facts"]["subject"]])
        axis.set_xlabel("Right (mm)")
    axes[0, 0].set_ylabel("Forward (mm)")
    labelled = (axis.get_legend_handles_labels() for axis in axes[0])
    figure.legend(*next(filter(any, labelled), ([], [])), loc="outside lower left", ncols=4)
    return figure


def _draw_support(axis, deposit: pd.DataFrame, functional_share: float, look: dict) -> None:
    """Draw the feet and centres of one person at the instant of the smallest margin; the origin is the middle of the base."""
    lowest = deposit["margin_of_stability_m"].idxmin()
    base = base_from_course(deposit.loc[[lowest]])
    origin, corners = base.centre[0], base.corners[0]
    for foot in (corners[: CORNERS // 2], corners[CORNERS // 2 :]):
        if np.isfinite(foot).all():
            outline = 1e3 * (corners_around(foot) - origin)
            axis.fill(*outline.T, facecolor=_LIGHT, edgecolor=_GREY, linewidth=0.8, label="_feet")
    outline = 1e3 * (corners_around(base.functional(functional_share).corners[0]) - origin)
    label = f"functional base ({functional_share:.0%})"
    axis.plot(*np.vstack([outline, outline[:1]]).T, color="black", linewidth=1.0, label=label)
    centre, path = (
        1e3 * (deposit[[f"{name}_x_m", f"{name}_y_m"]] - origin).to_numpy() for name in ("com", "xcom")
    )
    axis.plot(*centre.T, color=_GREY, linewidth=0.8, label="centre of mass")
    axis.plot(*path.T, **look, label="extrapolated centre")
    marker = {"marker": "o", "markersize": 4, "linestyle": "none"}
    axis.plot(*path[-1], color=look["color"], label="at the release", **marker)
    margin = f"{1e3 * deposit.loc[lowest, 'margin_of_stability_m']:+.0f} mm"
    nearest = path[deposit.index.get_loc(lowest)]
    note(axis, typeset_minus_signs(margin), nearest, (6, 4), fontsize=7, bbox=_WHITE)


_HEIGHTS = {
    "C7": ["C7", "T1"],
    "sternum": ["MANUBRIUM", "XIPHOID"],
    "pelvis": ["SACRUM", "L_PSIS", "R_PSIS", "L5"],
    "right wrist": ["R_WRIST"],
    "left wrist": ["L_WRIST"],
    "right foot": ["R_HEEL", "R_ANKLE", "R_TOE"],
    "left foot": ["L_HEEL", "L_ANKLE", "L_TOE"],
    "box": [f"BOX_{number}" for number in range(1, 9)],
}
"""Landmarks by name of a drawn height; the first landmark that the file contains is drawn."""
_GAP = "#bbbbbb"
_FINDING_COLOUR = "#D55E00"
_WHOLE_SHARE = 0.98
_MAX_ROWS = 40


@house_style
def quality_figure(
    sheet: QualitySheet, points: dict[str, np.ndarray], time: np.ndarray, meant: dict[str, str]
) -> Figure:
    """Draw heights over time, and below them one row per marker with gaps or findings.

    `sheet` is the report on the recording. `points` are the measured markers by the file's labels, shape (n_frames, 3),
    metres, z up; `time` has shape (n_frames,), seconds; `meant` is the label by standard name, by a laboratory's aliases.
    """
    # Markers with findings, then those with gaps, longest first.
    labels = [label for finding in sheet.findings for label in finding.markers]
    rows = list(dict.fromkeys([*labels, *(gap.marker for gap in sheet.gaps)]))[:_MAX_ROWS]
    height = 0.14 * max(len(rows), 3)
    figure, axes = new_figure(DOUBLE_COLUMN, 2.9 + height, nrows=2, sharex=True, height_ratios=[2.2, height])
    _draw_heights(axes[0], sheet, points, time, meant)
    _draw_faults(axes[1], sheet, points, time, rows)
    axes[1].set(xlabel="Time (s)", xlim=(float(time[0]), float(time[-1]) + 1 / sheet.rate_Hz))
    whole = [str(finding.kind) for finding in sheet.findings if not finding.markers]
    title = f"{Path(sheet.file).name}: {len(sheet.markers)} markers, {sheet.rate_Hz:g} Hz"
    figure.suptitle(title + (f"; {', '.join(whole)}!" if whole else ""), x=0.01, ha="left", fontweight="bold")
    return figure


def _draw_heights(axis, sheet: QualitySheet, points, time, meant) -> None:
    known = landmarks(points, meant)
    for index, (name, markers) in enumerate(_HEIGHTS.items()):
        label = next((known[marker] for marker in markers if marker in known), None)
        if label is None:
            continue
        text = name if name == label else f"{name} ({label})"
        color, line = SERIES[index % len(SERIES)], _LINES[index % len(_LINES)]
        height = points[label][:, 2]
        with np.errstate(invalid="ignore"):  # one outlier would flatten all others
            shown = np.where(np.abs(height) < LABORATORY_M, height, np.nan)
        axis.plot(time, shown, color=color, linestyle=line, label=text)
    for finding in sheet.findings:
        if finding.markers and finding.n_frames < _WHOLE_SHARE * len(time):
            end = finding.start_s + finding.length_s
            axis.axvspan(finding.start_s, end, color=_FINDING_COLOUR, alpha=0.15, lw=0)
    for event in sheet.events:
        axis.axvline(event.time, color=MEASURED, linewidth=0.6, linestyle=(0, (1, 2)))
    axis.set_ylabel("Height (m)")
    if axis.lines:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_faults(axis, sheet: QualitySheet, points, time, rows: list[str]) -> None:
    axis.grid(False)
    axis.set_yticks(range(len(rows)), rows, fontsize=6)
    axis.set_ylim(max(len(rows), 1) - 0.4, -0.6)
    if not rows:
        show_placeholder(axis, "no gaps, no findings", color="#555555")
        return
    for row, label in enumerate(rows):
        missing = ~np.isfinite(points[label]).all(axis=1)
        bars = [(time[gap.start], (gap.stop - gap.start) / sheet.rate_Hz) for gap in runs(missing)]
        axis.broken_barh(bars, (row - 0.4, 0.8), color=_GAP, linewidth=0)
        for finding in sheet.findings:
            if label in finding.markers:
                bar = [(finding.start_s, finding.length_s)]
                axis.broken_barh(bar, (row - 0.4, 0.8), facecolor=_FINDING_COLOUR, alpha=0.6, linewidth=0)
                middle = finding.start_s + finding.length_s / 2
                axis.text(middle, row, finding.kind, fontsize=5, ha="center", va="center")
    axis.set_title("grey: not seen; orange: cannot be a body's", loc="right", fontsize=6, color="#555555")
