"""Figures of the lifting chapter: events of a lift, the inverted pendulum (4.1), the trunk's segments (4.2)."""

from collections.abc import Mapping
from textwrap import fill

import numpy as np
import pandas as pd
import scipy
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from lumbar.base.errors import InputError, LumbarError
from lumbar.lifting.movement.lift_tables import WHOLE_BODY, points_of
from lumbar.lifting.movement.pendulum_states import pendulum_states
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import feedforward_torque
from lumbar.lifting.stability.model.pendulum_trajectories import Trajectory
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SEGMENTS,
    house_style,
    label_panels,
    new_figure,
    note,
    person_and_box,
    show_placeholder,
)
from lumbar.settings.lifting import PendulumSettings

EVENT_LABELS = {
    "lift_off": "lift-off",
    "toe_off": "first toe-off",
    "deposit_start": "start of deposit",
    "release": "release",
}
_BODY_LINES = (
    "C7-T12 T12-L5 L5-MID_HIP L_SHOULDER-R_SHOULDER L_HIP-R_HIP L_SHOULDER-L_WRIST R_SHOULDER-R_WRIST "
    "L_HIP-L_ANKLE R_HIP-R_ANKLE L_HEEL-L_TOE R_HEEL-R_TOE L_ANKLE-L_HEEL R_ANKLE-R_HEEL"
)
"""Lines of the stick figure; limbs without a marker at knee or elbow are straight."""
_FRONT = ["L_SHOULDER", "R_SHOULDER", "MANUBRIUM", "XIPHOID", "L_HIP", "R_HIP"]
_BACK = ["L_SHOULDER", "R_SHOULDER", "C7", "T12", "L5", "SACRUM", "L_HIP", "R_HIP"]
_NAME_SIDES = {"SHOULDER": "above", "HIP": "below", "C7": "over", "T12": "over", "L5": "over"}
"""Position of a marker's name in views from front and back; other names are to the right."""
_OFFSETS = {
    "left": ((-5, 0), "right", "center"),
    "right": ((5, 0), "left", "center"),
    "over": ((4, 1), "left", "bottom"),
    "above": ((0, 4), "center", "bottom"),
    "below": ((0, -4), "center", "top"),
}
"""Offset in points and alignments of a name by its position."""
_WHITE = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8}
_SEGMENT_MARKERS = {"thorax": "o", "abdomen": "s", "pelvis": "^"}
_DASHED, _DOTTED = (0, (4, 1.5)), (0, (1, 1))
_LINES = {"thorax": "-", "abdomen": _DASHED, "pelvis": _DOTTED}
_HANDS = {
    "box": {"label": "box", "color": "#D55E00", "linestyle": "-"},
    "wrists": {"label": "wrists", "color": "#0072B2", "linestyle": _DASHED},
    "l_wrist": {"label": "left wrist", "color": "#0072B2", "linestyle": _DASHED},
    "r_wrist": {"label": "right wrist", "color": "#56B4E9", "linestyle": _DOTTED},
}
_TOES = {
    "l_toe": {"label": "left toe", "color": "#009E73", "linestyle": "-"},
    "r_toe": {"label": "right toe", "color": "#CC79A7", "linestyle": _DASHED},
}
_END_NAMES = {"C7T1": "C7/T1", "T12L1": "T12/L1", "L4L5": "L4/L5", "L5S1": "L5/S1", "MID_HIP": "mid-hip"}
_XIPHOID = "xiphoid's level"
_GREY = "#888888"
_ABOVE = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0, "columnspacing": 1.0}
"""Place of a legend above its panel, where it covers no curve."""


@house_style
def events_figure(lift: dict) -> Figure:
    """Draw heights and speeds of box, wrists and toes over time, with the detected events.

    `lift` has ``motion`` (data frame with ``time_s``, ``<box|wrists|l_wrist|r_wrist>_height_m``, ``<…>_speed_m_s``),
    ``events`` (per event the result of `lumbar.lifting.movement.event_detection.Event.to_dict`) and ``summary`` (``lift``).
    """
    motion, events = lift["motion"], lift["events"]
    figure, axes = new_figure(DOUBLE_COLUMN, 4.6, nrows=3, sharex=True, height_ratios=[1, 1, 0.8])
    for name, look in _HANDS.items():
        for axis, quantity in zip(axes, ("height_m", "speed_m_s"), strict=False):
            if f"{name}_{quantity}" in motion:
                axis.plot(motion["time_s"], motion[f"{name}_{quantity}"], **look)
    feet = {name: look for name, look in _TOES.items() if f"{name}_speed_m_s" in motion}
    for name, look in feet.items():
        axes[2].plot(motion["time_s"], motion[f"{name}_speed_m_s"], **look)
    if not feet:
        show_placeholder(axes[2], "no markers on the feet", color=_GREY)
        axes[2].set_yticks([])
    for axis, label in zip(
        axes, ("Height (m)", "Speed (m/s)", "Toe speed (m/s)" if feet else ""), strict=True
    ):
        axis.set_ylabel(label)
    axes[2].set_xlabel("Time (s)")
    _mark_events(axes, events)
    for axis in axes[: 3 if feet else 2]:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlim(float(motion["time_s"].iloc[0]), float(motion["time_s"].iloc[-1]))
    figure.suptitle(person_and_box(lift["summary"]), x=0.01, ha="left", fontweight="bold")
    return figure


def _mark_events(axes, events: dict) -> None:
    """Draw a line through all panels at every event, with the event's name on top, and shade the deposit.

    Grey bands are the intervals of events; a dotted line is the event by the thesis's rule.
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
        text = f"{label}{' (set by hand)' if by_hand else ''}\n{event['time_s']:.2f} s"
        note(axes[0], text, (event["time_s"], 1.0), (0, 3), ha="center", **on_top)
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


@house_style
def pendulum_figure(lift: dict, pendulum: PendulumSettings) -> Figure:
    """Draw Figure 4.1: the inverted pendulum of the total body's centre of mass in flexion/extension, with ℓ, m and u0.

    The right panels have the angles of total body and trunk segments, and u0(t) by Eq. 4.1 with either sign of gravity.

    `lift` has ``landmarks`` (points at every event), ``body``, ``centres``, ``states`` (data frames) and ``summary``;
    `pendulum` has damping and gravity.
    """
    if lift["states"].empty:
        return _draw_reasons(lift)
    figure, axes = new_figure(DOUBLE_COLUMN, 4.4, ncols=2, nrows=2, sharex="col", width_ratios=(1, 1.15))
    for axis in axes[:, 0]:
        axis.remove()
    person, angles, torques = figure.add_subplot(axes[0, 0].get_gridspec()[:, 0]), *axes[:, 1]
    _draw_postures(person, lift)
    try:
        total = total_body_pendulum(lift["body"], lift["centres"], lift["summary"])
    except LumbarError as error:
        show_placeholder(torques, fill(str(error), 50), fontsize=7)
    else:
        _draw_pendulum(person, lift, total)
        angles.plot(total.time, total.angle, color=MEASURED, linewidth=1.8, label=total.com)
        for sign, line, label in (
            ("inverted", "-", "−mgℓ sin θ: inverted"),
            ("hanging", _DASHED, "+mgℓ sin θ: hanging, as printed"),
        ):
            torque = feedforward_torque(total, sign, pendulum.damping_N_m_s, pendulum.gravity_m_s2)
            torques.plot(total.time, torque, color=MEASURED, linestyle=line, label=label)
        torques.legend(ncols=2, **_ABOVE)
    for com, color in SEGMENTS.items():
        planar = lift["states"].query("com == @com and plane == 'flexion_extension'")
        angles.plot(planar["time_s"], planar["angle_rad"], color=color, linestyle=_LINES[com], label=com)
    angles.set_ylabel("Angle θ (rad)")
    angles.legend(ncols=4, **_ABOVE)
    torques.set(xlabel="Time (s)", ylabel="Torque $u_0$ of the total body (N·m)")
    label_panels((person, angles, torques))
    return figure


def _draw_postures(axis, lift: dict) -> None:
    """Draw the person at the start (light) and the end (dark) of the deposit, from the right."""
    for event, color, width in (("deposit_start", "#c4c4c4", 1.2), ("release", "#777777", 1.8)):
        points = _points(lift, event)
        # The outline of the box: the hull of its markers.
        corners = np.array([point[1:] for name, point in points.items() if name.startswith("BOX_")])
        if len(corners) >= 3 and np.linalg.matrix_rank(corners - corners[0], tol=1e-3) == 2:
            outline = corners[scipy.spatial.ConvexHull(corners).vertices]
            look = {"facecolor": "#f3e9d8", "edgecolor": color, "linewidth": 0.8, "zorder": 0}
            axis.add_patch(Polygon(outline, closed=True, **look))
        for line in _BODY_LINES.split():
            ends = [points[name][1:] for name in line.split("-") if name in points]
            if len(ends) == 2:
                axis.plot(*zip(*ends, strict=True), color=color, linewidth=width, solid_capstyle="round")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="y, forward (m)", ylabel="z, up (m)")
    axis.set_title("start (light), release (dark)", loc="right")


def _draw_pendulum(axis, lift: dict, total: Trajectory) -> None:
    """Draw the pendulum of the total body at the release, with rod ℓ, mass m, angle θ from the vertical, weight and torque u0."""
    pivot = np.array(_points(lift, "release")["PIVOT"][1:])
    angle, length = total.angle[-1], total.length_m
    along = np.array([np.sin(angle), np.cos(angle)])
    bob, far = pivot + length * along, pivot + 1.6 * length * along
    ink = {"color": MEASURED, "linestyle": ""}
    axis.plot(*zip(pivot, bob, strict=True), color=MEASURED, linewidth=2.0)
    axis.plot(*bob, marker="o", markersize=9, **ink)
    axis.plot(*pivot, marker="P", markersize=7, **ink)
    for start, stop in ((pivot, pivot + np.array([0, 1.6 * length])), (bob, far)):
        axis.plot(*zip(start, stop, strict=True), color=MEASURED, linewidth=0.7, linestyle=_DOTTED)
    note(axis, "θ", far, (0, 3), ha="right")
    note(axis, f"m = {total.mass_kg:g} kg", bob, (8, 0), va="center", bbox=_WHITE)
    note(axis, f"ℓ = {length:.2f} m", (pivot + bob) / 2, (6, 0), va="center")
    note(axis, f"pivot ({total.pivot.replace('_', '-')})", pivot, (36, -9))
    arrow = {"arrowstyle": "-|>", "color": "#D55E00", "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
    below, aside, above = np.array([[0, -0.3 * length], [0.14, 0], [0, 0.02]])
    axis.annotate("", bob + below, bob, arrowprops=arrow)
    note(axis, "mg", bob + below, (4, 0), color="#D55E00")
    around = arrow | {"connectionstyle": "arc3,rad=-0.5"}
    axis.annotate("", pivot + above + aside, pivot + above - aside, arrowprops=around)
    note(axis, r"$u_0$", pivot + above + aside, (4, 2), color="#D55E00")


@house_style
def segments_figure(lift: dict) -> Figure:
    """Draw Figure 4.2: the torso's markers and segments from front and back, and the study's segment ends from the side.

    `lift` has ``landmarks`` (points at every event), ``states`` and ``summary`` (``segments.ends``).
    """
    if lift["states"].empty:
        return _draw_reasons(lift)
    points = _points(lift, "deposit_start")
    shown = np.array([points[name] for name in (*_FRONT, *_BACK) if name in points])
    # Room for the names of the outermost markers; equal scales in all views.
    (left, back, low), (right, front, high) = shown.min(axis=0), shown.max(axis=0)
    x, y = (left - 0.08, right + 0.08), (back - 0.16, front + 0.2)
    wide = [np.ptp(x), np.ptp(x), np.ptp(y)]
    figure, axes = new_figure(DOUBLE_COLUMN, 3.7, ncols=3, sharey=True, width_ratios=wide)
    for axis, limits, markers in zip(axes[:2], (x[::-1], x), (_FRONT, _BACK), strict=True):
        _draw_segments(axis, points)
        for marker in filter(points.get, markers):
            _draw_marker(axis, marker, points[marker], 0, _NAME_SIDES.get(marker.rpartition("_")[2], "right"))
        axis.set(xlim=limits, xlabel="x, lateral (m)")
    # The line between the ends of every segment of the study, and the centre of mass on it.
    for segment, color in SEGMENTS.items():
        if f"COM_{segment}" in points:
            ends, look = lift["summary"]["segments"]["ends"][segment], {"color": color}
            band = zip(*(points[end][1:] for end in ends), strict=True)
            axes[2].plot(*band, linewidth=7, alpha=0.3, solid_capstyle="butt", **look)
            label = f"{segment}: {' to '.join(_END_NAMES.get(end, _XIPHOID) for end in ends)}"
            look |= {"marker": _SEGMENT_MARKERS[segment], "markersize": 8, "linestyle": "", "label": label}
            axes[2].plot(*points[f"COM_{segment}"][1:], **look)
    for marker in filter(points.get, dict.fromkeys((*_FRONT, *_BACK))):
        if not marker.startswith("L_"):
            _draw_marker(axes[2], marker, points[marker], 1, "right" if marker in _FRONT[2:] else "left")
    axes[2].set(xlim=y, xlabel="y, forward (m)", ylim=(low - 0.06, high + 0.05))
    axes[0].set_ylabel("z, up (m)")
    label_panels(axes)
    for axis, view in zip(axes, ("front", "back", "side: ends in use"), strict=True):
        axis.set_title(view, loc="right")
        axis.set_aspect("equal")
    handles = axes[2].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3, title="centres of mass, side")
    return figure


def _draw_segments(axis, points: dict) -> None:
    """Fill the torso between shoulders and hips in segments that end at the heights of the markers T12 and L5."""
    needed = ("L_SHOULDER", "R_SHOULDER", "L_HIP", "R_HIP", "C7", "T12", "L5")
    missing = [name for name in needed if name not in points]
    if missing:
        show_placeholder(axis, fill(f"no marker {', '.join(missing)}", 20), fontsize=7)
        return
    left, right, low_left, low_right, top, *between = (np.array(points[name])[[0, 2]] for name in needed)
    borders = [[left, top, right]]
    for middle in between:
        # The points at which the height of a marker cuts the torso's sides.
        sides = (
            up + (middle[1] - up[1]) / (down[1] - up[1]) * (down - up)
            for up, down in ((left, low_left), (right, low_right))
        )
        borders.append([next(sides), middle, next(sides)])
    borders.append([low_left, (low_left + low_right) / 2, low_right])
    for (segment, color), upper, lower in zip(SEGMENTS.items(), borders, borders[1:], strict=False):
        corners = np.array([*upper, *lower[::-1]])
        axis.fill(*corners.T, linewidth=1.0, facecolor=to_rgba(color, 0.35), edgecolor=color)
        place = (0.75 * upper[0] + 0.25 * upper[2] + 0.75 * lower[0] + 0.25 * lower[2]) / 2
        axis.text(*place, segment, ha="center", va="center", fontsize=7, bbox=_WHITE)


@house_style
def _draw_reasons(lift: dict) -> Figure:
    """Write the reasons why a lift has no pendulum."""
    figure, axes = new_figure(DOUBLE_COLUMN, 2.0)
    reasons = "\n".join(dict.fromkeys(lift["summary"]["missing"].values())).splitlines()
    text = "\n".join(
        [f"{person_and_box(lift['summary'])}: no pendulum", *(fill(line, 110) for line in reasons)]
    )
    axes.set_axis_off()
    axes.text(0, 1, text, va="top", fontsize=7)
    return figure


def _draw_marker(axis, marker: str, point, horizontal: int, side: str) -> None:
    """Draw a marker with its name at its left, right, top or bottom."""
    axis.plot(point[horizontal], point[2], marker="o", color=MEASURED, markersize=3, linestyle="")
    limb, _, part = marker.rpartition("_")
    name = f"{part if len(part) <= 3 and not limb else part.lower()}{f' ({limb})' if limb else ''}"
    offset, across, up = _OFFSETS[side]
    note(axis, name, (point[horizontal], point[2]), offset, ha=across, va=up, fontsize=6.5)


PLANE = "flexion_extension"


def total_body_pendulum(body: pd.DataFrame, centres: pd.DataFrame, facts: Mapping) -> Trajectory:
    """Return the trajectory of the total body's centre of mass about the study's pivot in real time.

    `body` and `centres` are ``body.csv`` and ``com.csv`` of a lift with a deposit, `facts` is its ``pendulum.json``.

    Raises
    ------
    InputError
        If the body's centre of mass is unknown in a part of the deposit.
    NumericalError
        If the centre of mass comes too close to the pivot.
    """
    points = points_of(body)
    if WHOLE_BODY not in points:
        reason = facts.get("missing_points", {}).get(WHOLE_BODY, "its markers are not in the recording")
        raise InputError(f"no centre of mass of the total body: {reason}")
    pivot = centres[centres["com"] == centres["com"].iloc[0]][[f"pivot_{axis}_m" for axis in "xyz"]]
    relative = points[WHOLE_BODY] - pivot.to_numpy(float)
    interval = facts["start_s"], facts["stop_s"], facts["points"]
    states = pendulum_states(body["time_s"].to_numpy(), relative, *interval)[PLANE]
    return Trajectory(
        subject=facts["subject"],
        experience=facts.get("experience", ""),
        box_mass_kg=facts["box_mass_kg"],
        com="total body",
        plane=PLANE,
        pivot=facts["pivot"],
        time=states.time,
        angle=states.angle,
        angular_velocity=states.angular_velocity,
        angular_acceleration=states.angular_acceleration,
        mass_kg=facts["body_mass_kg"],
        length_m=float(states.length.mean()),
        mass_counted="without_box",
    )
