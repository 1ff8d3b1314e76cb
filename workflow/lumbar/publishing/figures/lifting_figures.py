"""Figures of the lifting chapter: events of a lift, the inverted pendulum (4.1), the trunk's segments
(4.2)."""

from __future__ import annotations

from matplotlib.figure import Figure

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SEGMENTS,
    house_style,
    label_panels,
    new_figure,
    note,
    person_and_box,
    say_instead,
)

EVENT_LABELS = {
    "lift_off": "lift-off",
    "toe_off": "first toe-off",
    "deposit_start": "start of deposit",
    "release": "release",
}
_BODY = (
    *(("C7", "T12"), ("T12", "L5"), ("L5", "MID_HIP"), ("L_SHOULDER", "R_SHOULDER"), ("L_HIP", "R_HIP")),
    *(("L_SHOULDER", "L_WRIST"), ("R_SHOULDER", "R_WRIST"), ("L_HIP", "L_ANKLE"), ("R_HIP", "R_ANKLE")),
    *(("L_HEEL", "L_TOE"), ("R_HEEL", "R_TOE"), ("L_ANKLE", "L_HEEL"), ("R_ANKLE", "R_HEEL")),
)
"""Lines of the stick figure; limbs without a marker at knee or elbow are straight."""
_TORSO = (
    *("C7", "T12", "L5", "MANUBRIUM", "XIPHOID", "SACRUM", "L_SHOULDER", "R_SHOULDER", "L_HIP", "R_HIP"),
)
_OUTLINE = (
    *(("L_SHOULDER", "R_SHOULDER"), ("L_HIP", "R_HIP"), ("L_SHOULDER", "L_HIP"), ("R_SHOULDER", "R_HIP")),
    *(("C7", "MANUBRIUM"), ("MANUBRIUM", "XIPHOID"), ("L5", "SACRUM")),
)
_MARKS = {"thorax": "o", "abdomen": "s", "pelvis": "^"}
_DASHED, _DOTTED = (0, (4, 1.5)), (0, (1, 1))
_LINES = {"thorax": "-", "abdomen": _DASHED, "pelvis": _DOTTED}
_HANDS = {
    "box": {"label": "box", "color": "#D55E00", "linestyle": "-"},
    "wrists": {"label": "wrists", "color": "#0072B2", "linestyle": _DASHED},
    "l_wrist": {"label": "left wrist", "color": "#0072B2", "linestyle": _DASHED},
    "r_wrist": {"label": "right wrist", "color": "#56B4E9", "linestyle": _DOTTED},
}
_GREY = "#888888"


@house_style
def events_figure(lift: dict) -> Figure:
    """Draw heights and speeds of box, wrists and toes over time, with the events found in them.

    Parameters
    ----------
    lift : dict
        ``motion`` (data frame with ``time_s``, ``<box|wrists|l_wrist|r_wrist>_height_m``, ``<…>_speed_m_s``), ``events``
        (per event as of `lumbar.lifting.movement.event_detection.Event.as_dict`) and ``summary`` (``lift``).
    """
    motion, events = lift["motion"], lift["events"]
    figure, axes = new_figure(DOUBLE_COLUMN, 4.6, nrows=3, sharex=True, height_ratios=[1, 1, 0.8])
    for name, look in _HANDS.items():
        for axis, quantity in ((axes[0], "height_m"), (axes[1], "speed_m_s")):
            if f"{name}_{quantity}" in motion:
                axis.plot(motion["time_s"], motion[f"{name}_{quantity}"], **look)
    feet = [name for name in ("l_toe", "r_toe") if f"{name}_speed_m_s" in motion]
    for name, color, line in zip(feet, ("#009E73", "#CC79A7"), ("-", _DASHED), strict=False):
        label = "left toe" if name == "l_toe" else "right toe"
        axes[2].plot(motion["time_s"], motion[f"{name}_speed_m_s"], color=color, linestyle=line, label=label)
    if not feet:
        say_instead(axes[2], "no markers on the feet", color=_GREY)
        axes[2].set_yticks([])
    axes[0].set_ylabel("Height (m)")
    axes[1].set_ylabel("Speed (m/s)")
    axes[2].set(ylabel="Toe speed (m/s)" if feet else "", xlabel="Time (s)")
    _mark_events(axes, events)
    for axis in axes[: 3 if feet else 2]:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlim(float(motion["time_s"].iloc[0]), float(motion["time_s"].iloc[-1]))
    figure.suptitle(_lift_name(lift), x=0.01, ha="left", fontweight="bold")
    return figure


def _lift_name(lift: dict) -> str:
    return person_and_box(lift["summary"])


def _mark_events(axes, events: dict) -> None:
    """Draw a line through all panels at every event, its name on top, and shade the deposit.

    Grey bands are the intervals of events; a dotted line is where the thesis's own rule puts one.
    """
    on_top = {"xycoords": ("data", "axes fraction"), "fontsize": 6.5}
    deposit = [events[name]["time_s"] for name in ("deposit_start", "release")]
    for axis in axes:
        if None not in deposit:
            axis.axvspan(*deposit, color="#eeeeee", zorder=0)
    for name, label in EVENT_LABELS.items():
        event = events[name]
        if event["time_s"] is None:
            continue
        by_hand = event["method"] == "declared"
        for axis in axes:
            axis.axvline(event["time_s"], color=MEASURED, linewidth=0.8, linestyle="--" if by_hand else "-")
            if event["earliest_s"] is not None:
                axis.axvspan(event["earliest_s"], event["latest_s"], color="#cccccc", zorder=0.5)
            if event["thesis_s"] is not None:
                axis.axvline(event["thesis_s"], color=_GREY, linewidth=1.2, linestyle=":")
        words = f"{label}{' (set by hand)' if by_hand else ''}\n{event['time_s']:.2f} s"
        note(axes[0], words, (event["time_s"], 1.0), (0, 3), ha="center", **on_top)
    thesis = events["deposit_start"]["thesis_s"]
    if thesis is not None:
        upwards = {"ha": "right", "va": "top", "rotation": 90, "color": _GREY, **on_top}
        note(axes[1], "thesis's rule", (thesis, 1.0), (-2, -2), **upwards)
    if events["toe_off"]["time_s"] is None and len(axes[2].lines) > len(EVENT_LABELS) - 1:
        axes[2].set_title("no toe-off", loc="right", fontsize=7)


def _points(lift: dict, event: str) -> dict[str, tuple[float, float, float]]:
    frame = lift["landmarks"]
    rows = frame[frame["event"] == event]
    return {row.point: (row.x_m, row.y_m, row.z_m) for row in rows.itertuples()}


def _stick_figure(axis, points: dict, horizontal: int, color: str, width: float) -> None:
    for pair in _BODY:
        if all(name in points for name in pair):
            ends = zip(*((points[name][horizontal], points[name][2]) for name in pair), strict=True)
            axis.plot(*ends, color=color, linewidth=width, solid_capstyle="round")


def _box(axis, points: dict, horizontal: int, color: str) -> None:
    """Outline of the box: the hull of its markers as seen in this view."""
    import numpy as np
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    corners = np.array(
        [[point[horizontal], point[2]] for name, point in points.items() if name.startswith("BOX_")]
    )
    if len(corners) >= 3 and np.linalg.matrix_rank(corners - corners[0], tol=1e-3) == 2:
        outline = corners[ConvexHull(corners).vertices]
        look = {"facecolor": "#f3e9d8", "edgecolor": color, "linewidth": 0.8, "zorder": 0}
        axis.add_patch(Polygon(outline, closed=True, **look))


@house_style
def pendulum_figure(lift: dict) -> Figure:
    """Figure 4.1: the inverted pendulums in flexion/extension, drawn on the person at the release.

    Parameters
    ----------
    lift : dict
        ``landmarks`` (points at every event), ``centres``, ``states`` (data frames) and ``summary``.
    """
    summary, states = lift["summary"], lift["states"]
    if states.empty:
        return _without_deposit(lift)
    figure, axes = new_figure(DOUBLE_COLUMN, 4.0, ncols=2)
    before, after = _points(lift, "deposit_start"), _points(lift, "release")
    for points, color, width in ((before, "#c4c4c4", 1.2), (after, "#444444", 1.8)):
        _box(axes[0], points, 1, color)
        _stick_figure(axes[0], points, 1, color, width)
    pivot = after["PIVOT"]
    deposit = lift["centres"][lift["centres"]["phase"] == "deposit"]
    for com, color in SEGMENTS.items():
        if f"COM_{com}" not in after:
            continue
        path = deposit[deposit["com"] == com]
        axes[0].plot(path["y_m"], path["z_m"], color=color, linewidth=1.0)
        point = after[f"COM_{com}"]
        rod = [pivot[1], point[1]], [pivot[2], point[2]]
        axes[0].plot(*rod, color=color, linestyle=_LINES[com], linewidth=1.0)
        axes[0].plot(*point[1:], marker=_MARKS[com], color=color, markersize=6, linestyle="", label=com)
        planar = states[(states["com"] == com) & (states["plane"] == "flexion_extension")]
        axes[1].plot(planar["time_s"], planar["angle_rad"], color=color, linestyle=_LINES[com], label=com)
    axes[0].plot(pivot[1], pivot[2], marker="P", color=MEASURED, markersize=7, linestyle="")
    note(axes[0], f"pivot ({summary['pivot'].replace('_', '-')})", pivot[1:], (7, 4))
    top = max(after[f"COM_{com}"][2] for com in SEGMENTS if f"COM_{com}" in after)
    axes[0].plot([pivot[1]] * 2, [pivot[2], top + 0.1], color=MEASURED, linewidth=0.6, linestyle=(0, (1, 3)))
    note(axes[0], "θ = 0", (pivot[1], top + 0.1), (-2, 2), ha="right")
    axes[0].set_aspect("equal", adjustable="datalim")
    axes[0].set(xlabel="y, forward (m)", ylabel="z, up (m)")
    axes[1].set(xlabel="Time (s)", ylabel="Angle θ in flexion/extension (rad)")
    axes[1].legend(title="centre of mass")
    label_panels(axes)
    axes[0].set_title("deposit: start (light), release (dark)", loc="right")
    axes[1].set_title(_lift_name(lift), loc="right")
    return figure


@house_style
def segments_figure(lift: dict) -> Figure:
    """Figure 4.2: torso markers, the three trunk segments and their centres of mass, from the front and the
    side.

    Parameters
    ----------
    lift : dict
        ``landmarks`` (points at every event), ``states`` and ``summary`` (``segments.ends``).
    """
    if lift["states"].empty:
        return _without_deposit(lift)
    points = _points(lift, "deposit_start")
    ends = lift["summary"]["segments"]["ends"]
    shown = [points[name] for name in _TORSO if name in points]
    # Room for the names beside the outermost markers; equal scales in both views.
    limits = [(min(column) - 0.16, max(column) + 0.16) for column in list(zip(*shown, strict=True))[:2]]
    figure, axes = new_figure(
        DOUBLE_COLUMN, 4.4, ncols=2, sharey=True, width_ratios=[high - low for low, high in limits]
    )
    for axis, horizontal, name in ((axes[0], 0, "x, lateral (m)"), (axes[1], 1, "y, forward (m)")):
        for segment, color in SEGMENTS.items():
            if f"COM_{segment}" not in points:
                continue
            band = zip(*((points[end][horizontal], points[end][2]) for end in ends[segment]), strict=True)
            axis.plot(*band, color=color, linewidth=7, alpha=0.3, solid_capstyle="butt")
            centre = points[f"COM_{segment}"]
            label = f"{segment}: {_end_name(ends[segment][0])} to {_end_name(ends[segment][1])}"
            axis.plot(
                *(centre[horizontal], centre[2]),
                marker=_MARKS[segment],
                color=color,
                markersize=8,
                linestyle="",
                label=label,
            )
        for start, stop in _OUTLINE:
            if start in points and stop in points:
                ends_seen = [(points[name][horizontal], points[name][2]) for name in (start, stop)]
                axis.plot(*zip(*ends_seen, strict=True), color="#bbbbbb", linewidth=0.8, zorder=0)
        for marker in _TORSO:
            if marker in points:
                _torso_marker(axis, marker, points[marker], horizontal)
        axis.set_xlim(*limits[horizontal])
        axis.set(aspect="equal", xlabel=name)
    axes[0].invert_xaxis()
    axes[0].set_ylabel("z, up (m)")
    label_panels(axes)
    axes[0].set_title("front", loc="right")
    axes[1].set_title("side", loc="right")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, title="centres of mass"
    )
    return figure


@house_style
def _without_deposit(lift: dict) -> Figure:
    """A figure that says why there is nothing to draw."""
    import textwrap

    figure, axes = new_figure(DOUBLE_COLUMN, 2.0)
    said = "\n".join(dict.fromkeys(lift["summary"]["missing"].values()))
    lines = [part for line in said.splitlines() for part in textwrap.wrap(line, 110)]
    axes.set_axis_off()
    axes.text(0, 1, "\n".join([f"{_lift_name(lift)}: no pendulum", *lines]), va="top", fontsize=7)
    return figure


def _end_name(end: str) -> str:
    named = {"C7T1": "C7/T1", "T12L1": "T12/L1", "L4L5": "L4/L5", "L5S1": "L5/S1", "MID_HIP": "mid-hip"}
    return named.get(end, "xiphoid's level")


def _torso_marker(axis, marker: str, point, horizontal: int) -> None:
    """Draw a marker with its name beside the trunk; in the side view the far one of a pair has no name."""
    axis.plot(point[horizontal], point[2], marker="o", color=MEASURED, markersize=3, linestyle="")
    if horizontal == 1 and marker.startswith("L_"):
        return
    if horizontal == 0:
        # The axis is inverted: the person's right is on the viewer's left.
        left = marker.startswith("R_") or marker in ("MANUBRIUM", "XIPHOID")
    else:
        left = marker in ("C7", "T12", "L5", "SACRUM")
    name = marker if len(marker) <= 3 else marker.lower().replace("l_", "left ").replace("r_", "right ")
    look = {"ha": "right" if left else "left", "va": "center", "fontsize": 6.5}
    note(axis, name, (point[horizontal], point[2]), (-5 if left else 5, 0), **look)
