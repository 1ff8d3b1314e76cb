"""Pictures of a lift's page: body from two sides and above, courses over time, and a pendulum's funnel."""

from collections.abc import Callable

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, DataRange1d, LabelSet, Range1d, Span
from bokeh.plotting import figure

from lumbar.publishing.explorer.one_file import empty_source, plain_figure
from lumbar.publishing.figures.style import MEASURED, SEGMENTS, SERIES

GREY, GOAL, PUSHED = "#888888", SERIES[3], SERIES[4]
"""Colours of the background, the goal set and the pushed path."""
CERTIFIED = SERIES[5]
DASHES = {"thorax": [], "abdomen": [8, 3], "pelvis": [3, 2]}
MARKS = {
    "thorax": "circle",
    "abdomen": "square",
    "pelvis": "triangle",
    "whole body": "diamond",
    "box": "square_x",
}
"""Look of the centres of mass: readable in grey."""
SHADES = {"lift": 0.10, "carry": 0.02, "deposit": 0.22}
"""Opacity of the phases behind the courses."""
OUTLINES = 9
"""Cross-sections of the funnel drawn in addition to the present one."""


def lift_pictures() -> list[figure]:
    """Return the pictures in the order of the page; the page's script fills them."""
    side = _body("side", "y, forward (m)")
    behind = _body("behind", "x, to the right (m)")
    margin = _course("margin", "Margin of stability (mm)")
    angle = _course("angle", "Angle θ (rad)")
    velocity = _course("velocity", "Angular velocity (rad/s)", x_range=angle.x_range)
    _draw_margin(margin)
    for picture, name in ((angle, "angles"), (velocity, "velocities")):
        source = empty_source(name, ("time", *SEGMENTS))
        for com, colour in SEGMENTS.items():
            picture.line("time", com, source=source, color=colour, line_width=2.2, line_dash=DASHES[com])
    return [side, behind, _top_view(), margin, angle, velocity, *_funnel()]


def _draw(glyph: Callable, source: str, *columns: str, **look) -> None:
    """Draw a glyph of a source that the script fills; the first two columns are the coordinates."""
    glyph(*columns[:2], source=empty_source(source, columns), **look)


def _figure(name: str, across: str, up: str, height: int, tools: str = "", **more) -> figure:
    toolbar = {"tools": tools, "toolbar_location": "right" if tools else None}
    return plain_figure(name, across, up, height=height, left=60, **toolbar, **more)


def _fix_ranges(picture: figure, name: str) -> None:
    """Fix the ranges to bounds that the script sets, with equal scales."""
    corners = ColumnDataSource({"x": [-0.5, 0.5], "y": [-0.5, 0.5]}, name=name)
    unseen = picture.scatter("x", "y", source=corners, size=0, alpha=0)
    picture.x_range = DataRange1d(renderers=[unseen], range_padding=0.06)
    picture.y_range = DataRange1d(renderers=[unseen], range_padding=0.06)


def _body(name: str, across: str) -> figure:
    """Draw stick figure, centres of mass and pendulums."""
    picture = _figure(name, across, "z, up (m)", 420, match_aspect=True)
    _fix_ranges(picture, f"{name}:bounds")
    ink, dash = {"line_color": MEASURED, "line_width": 2.5}, {"line_dash": {"field": "dash"}}
    _draw(picture.scatter, f"{name}:head", "x", "z", size=20, fill_color=None, name="ink head", **ink)
    limbs = {"line_cap": "round", "name": "ink limbs", **ink, **dash}
    _draw(picture.multi_line, f"{name}:limbs", "x", "z", "dash", **limbs)
    rods = {"color": {"field": "colour"}, "line_width": 1.5, **dash}
    _draw(picture.multi_line, f"{name}:pendulums", "x", "z", "colour", "dash", **rods)
    look = {"marker": {"field": "mark"}, "fill_color": {"field": "colour"}, "size": {"field": "size"}}
    columns = ("x", "y", "mark", "colour", "size")
    _draw(picture.scatter, f"{name}:centres", *columns, line_color="white", **look)
    return picture


def _top_view() -> figure:
    """Draw base of support, centre of mass and extrapolated centre from above."""
    picture = _figure("above", "x, to the right (m)", "y, forward (m)", 420, match_aspect=True)
    _fix_ranges(picture, "above:bounds")
    _draw(picture.patch, "above:base", "x", "y", fill_color=GREY, fill_alpha=0.35, line_color=GREY)
    _draw(picture.line, "above:used", "x", "y", color=MEASURED, line_width=1.6, name="ink used")
    _draw(picture.line, "above:trail", "x", "y", color=SERIES[3], line_width=1, alpha=0.6)
    for name, marker, size, colour in (("com", "diamond", 13, SERIES[0]), ("xcom", "star", 16, SERIES[3])):
        look = {"marker": marker, "size": size, "fill_color": colour, "line_color": "white"}
        _draw(picture.scatter, f"above:{name}", "x", "y", **look)
    return picture


def _course(name: str, up: str, **more) -> figure:
    """Return a picture over the recording's time with the present instant as a line; a click goes to that time."""
    ranges = {"x_range": Range1d(0, 1), "y_range": Range1d(0.1, 1), **more}  # the page's script sets them
    picture = _figure(name, "Time (s)", up, 220, "xpan,xbox_zoom,xwheel_zoom,reset", **ranges)
    picture.toolbar.active_drag = picture.toolbar.active_scroll = None
    look = {"line_color": MEASURED, "line_width": 1.5, "name": f"ink now:{name}"}
    picture.add_layout(Span(dimension="height", location=np.nan, **look))
    picture.js_on_event("tap", CustomJS(code="window.lumbarLift.tapped(cb_obj)"))
    return picture


def _draw_margin(picture: figure) -> None:
    """Draw the margin over time with the phases behind."""
    phases = empty_source("phases", ("start", "stop", "shade", "phase"))
    grey = {"fill_color": GREY, "fill_alpha": "shade", "line_color": None}
    picture.vstrip(x0="start", x1="stop", source=phases, level="underlay", **grey)
    label = {"text": "phase", "text_font_size": "11px", "text_color": MEASURED, "name": "ink phases"}
    picture.add_layout(LabelSet(x="start", y=2, x_offset=3, y_units="screen", source=phases, **label))
    picture.add_layout(Span(dimension="width", location=0, line_color=GREY, line_dash=[4, 3]))
    _draw(picture.line, "margins", "time", "margin", color=SERIES[3], line_width=1.8)


def _funnel() -> list[figure]:
    """Draw cross-sections with the push, the funnel over time, and V/ρ over time."""
    over_time = _course("funnel", "Angle off it (rad)")
    level = _course("level", "V/ρ", x_range=over_time.x_range, y_axis_type="log")
    band = empty_source("band", ("time", "low", "high", "least", "most"))
    over_time.varea("time", "low", "high", source=band, fill_color=CERTIFIED, fill_alpha=0.4)
    for edge in ("least", "most"):
        over_time.line("time", edge, source=band, color=MEASURED, line_dash=[5, 3], name=f"ink {edge}")
    level.add_layout(Span(dimension="width", location=1, line_color=CERTIFIED, line_width=2.5))
    path = empty_source("path", ("time", "angle", "velocity", "level"))
    for picture, up in ((over_time, "angle"), (level, "level")):
        picture.line("time", up, source=path, color=PUSHED, line_width=2.2)
    return [_plane(path), over_time, level]


def _plane(path: ColumnDataSource) -> figure:
    """Draw the phase plane about the trajectory: a click or dragging there pushes the pendulum."""
    labels = ("Angle off the trajectory (rad)", "Angular velocity off it (rad/s)")
    picture = _figure("plane", *labels, 460, x_range=Range1d(-1, 1), y_range=Range1d(-1, 1))
    blue, ink = {"line_color": SERIES[0], "line_width": 2.5}, {"line_color": MEASURED}
    _draw(picture.patch, "certified", "x", "y", fill_color=CERTIFIED, fill_alpha=0.45, **blue)
    outlines = {"color": SERIES[0], "alpha": {"field": "alpha"}, "line_width": 1}
    _draw(picture.multi_line, "outlines", "x", "y", "alpha", **outlines)
    _draw(picture.line, "goal", "x", "y", color=GOAL, line_width=2, line_dash=[2, 3])
    _draw(picture.line, "reached", "x", "y", line_width=1.8, line_dash=[6, 3], name="ink reached", **ink)
    picture.line("angle", "velocity", source=path, color=PUSHED, line_width=2.2)
    push = {"marker": "circle_cross", "size": 22, "color": PUSHED, "fill_alpha": 0.25, "line_width": 2}
    _draw(picture.scatter, "pushed", "x", "y", **push)
    present = {"marker": "diamond", "size": 13, "fill_color": PUSHED, "line_color": "white"}
    _draw(picture.scatter, "present", "x", "y", **present)
    picture.scatter([0], [0], marker="cross", size=12, name="ink trajectory", **ink)
    for event in ("tap", "panstart", "pan", "panend"):
        picture.js_on_event(event, CustomJS(code="window.lumbarLift.dragged(cb_obj)"))
    return picture
