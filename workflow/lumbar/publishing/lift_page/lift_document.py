"""Interactive page of a lift: pictures, data of the pictures, and variables of the template."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, DataRange1d, LabelSet, Range1d, Span
from bokeh.plotting import figure

from lumbar.base.files import write_text
from lumbar.base.templates import typeset_minus_signs
from lumbar.lifting.measures.course import Course, Lifter, course_of_lift
from lumbar.lifting.measures.lift_values import (
    MEASURES,
    WINDOWS,
    headline_sentence,
    print_measure,
    values_of_lift,
)
from lumbar.lifting.movement.lift_tables import points_of
from lumbar.lifting.stability.model.pendulum_trajectories import Failure, LiftStates
from lumbar.publishing.explorer.one_file import (
    EmbeddedPictures,
    add_roots,
    embed_pictures,
    empty_source,
    one_file,
    plain_figure,
)
from lumbar.publishing.figures.lifting_figures import EVENT_LABELS
from lumbar.publishing.figures.stability_figures import PLANE_TITLES
from lumbar.publishing.figures.style import MEASURED, SEGMENTS, SERIES
from lumbar.publishing.lift_page import lift_data
from lumbar.publishing.pages.sketches import stick_figure
from lumbar.settings.lifting import StabilitySettings

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
"""Colour and marker of the centres of mass, readable in grey."""
SHADES = {"lift": 0.10, "carry": 0.02, "deposit": 0.22}
"""Opacity of the phases behind the courses."""
OUTLINES = 9
"""Number of cross-sections of the funnel drawn in addition to the present cross-section."""


def lift_pictures() -> list[figure]:
    """Return the empty pictures in the order of the page, whose script fills them."""
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
    """Draw a glyph from a source that the script fills; the first two columns are the coordinates."""
    glyph(*columns[:2], source=empty_source(source, columns), **look)


def _figure(name: str, across: str, up: str, height: int, tools: str = "", **more) -> figure:
    toolbar = {"tools": tools, "toolbar_location": "right" if tools else None}
    return plain_figure(name, across, up, height=height, left=60, **toolbar, **more)


def _fix_ranges(picture: figure, name: str) -> None:
    """Fix the ranges to bounds that the script sets, with equal scales."""
    corners = ColumnDataSource({"x": [-0.5, 0.5], "y": [-0.5, 0.5]}, name=name)
    unseen = picture.scatter("x", "y", source=corners, size=0, alpha=0)
    picture.x_range = DataRange1d(renderers=[unseen], range_padding=0.1)
    picture.y_range = DataRange1d(renderers=[unseen], range_padding=0.1)


def _body(name: str, across: str) -> figure:
    """Draw stick figure, centres of mass and pendulums."""
    picture = _figure(name, across, "z, up (m)", 380, match_aspect=True)
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
    picture = _figure("above", "x, to the right (m)", "y, forward (m)", 380, match_aspect=True)
    _fix_ranges(picture, "above:bounds")
    _draw(picture.patch, "above:base", "x", "y", fill_color=GREY, fill_alpha=0.35, line_color=GREY)
    _draw(picture.line, "above:used", "x", "y", color=MEASURED, line_width=1.6, name="ink used")
    _draw(picture.line, "above:trail", "x", "y", color=SERIES[3], line_width=1, alpha=0.6)
    for name, marker, size, colour in (("com", "diamond", 13, SERIES[0]), ("xcom", "star", 16, SERIES[3])):
        look = {"marker": marker, "size": size, "fill_color": colour, "line_color": "white"}
        _draw(picture.scatter, f"above:{name}", "x", "y", **look)
    return picture


def _course(name: str, up: str, **more) -> figure:
    """Return a picture over the recording's time with a line at the present instant; a click selects an instant."""
    ranges = {"x_range": Range1d(0, 1), "y_range": Range1d(0.1, 1), **more}  # the page's script sets them
    picture = _figure(name, "Time (s)", up, 220, "xpan,xbox_zoom,xwheel_zoom,reset", **ranges)
    picture.toolbar.active_drag = picture.toolbar.active_scroll = None
    picture.toolbar.autohide = True
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
    """Draw cross-sections with the pushed path, the funnel over time, and V/ρ over time."""
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
    """Draw the phase plane about the trajectory, in which a click or a drag pushes the pendulum."""
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


PAGE = "publishing/lift_page/lift_page.html.jinja"
N_STATES = 250
"""Number of drawn instants of a pendulum's states."""


@cache
def _pictures() -> EmbeddedPictures:
    """Return the pictures, which are identical for every page because the page's script fills them."""
    return embed_pictures(lambda document: add_roots(document, lift_pictures()))


@dataclass(frozen=True, eq=False)
class LiftPage:
    """Interactive page of a lift."""

    lift: lift_data.LiftTables
    settings: StabilitySettings

    @cached_property
    def course(self) -> Course:
        """Measures of the lift at every instant."""
        gravity = self.settings.pendulum.gravity_m_s2
        return course_of_lift(Lifter(self.lift.body, self.lift.facts, self.settings.measures, gravity))

    @cached_property
    def _pendulums(self) -> tuple[list[lift_data.PushedPendulum], list[Failure]]:
        return lift_data.pushed_pendulums(LiftStates(self.lift.states, self.lift.facts), self.settings)

    @cached_property
    def _frames(self) -> slice:
        """Slice of the drawn frames, evenly spaced from the first."""
        time = self.lift.body["time_s"].to_numpy()
        rate = (len(time) - 1) / (time[-1] - time[0])
        steps = rate / lift_data.MAX_FRAMES_PER_S, len(time) / lift_data.MAX_FRAMES
        return slice(None, None, max(1, *map(math.ceil, steps)))

    @cached_property
    def _balance(self) -> dict[str, np.ndarray]:
        share = self.settings.measures.functional_share
        return lift_data.balance_columns(self.course.frame, share, self._frames)

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"Lift {self.lift.facts['lift']}".replace("_", " ")

    def _sources(self) -> list[ColumnDataSource]:
        """Return the data that the page's script draws."""
        columns = {"body": lift_data.body_columns(self.lift, self._frames)}
        outlines = {name: values.ravel() for name, values in self._balance.items() if values.ndim == 2}
        if outlines:
            columns["balance"] = {name: values for name, values in self._balance.items() if values.ndim == 1}
            columns["bases"] = outlines
        for (com, plane), rows in self.lift.states.groupby(["com", "plane"], sort=False):
            drawn = rows.iloc[np.linspace(0, len(rows) - 1, N_STATES).round().astype(int)]
            names = {"time": "time_s", "angle": "angle_rad", "velocity": "angular_velocity_rad_s"}
            states = {name: drawn[column].to_numpy(float) for name, column in names.items()}
            columns[f"states:{com}/{plane}"] = states
        for item in self._pendulums[0]:
            columns |= {f"loop:{item.key}": item.columns, f"level:{item.key}": {"level": item.level}}
        return [ColumnDataSource(values, name=name) for name, values in columns.items()]

    def variables(self) -> dict[str, Any]:
        """Return the template's variables."""
        pendulum = self.settings.pendulum
        pendulums, failures = self._pendulums
        return {
            "title": self.title,
            "data": self.lift.source_label,
            "facts": self.lift.facts,
            "events": self.lift.events,
            "absent": self._list_absent(failures),
            "event_labels": EVENT_LABELS,
            "measures": self._measures(),
            "notes": self.course.notes,
            "no_balance": self.course.missing.get("margin_of_stability_m", ""),
            "share": self.settings.measures.functional_share,
            "centres": self._centres,
            "has_states": not self.lift.states.empty,
            "planes": PLANE_TITLES,
            "pendulums": pendulums,
            "sign": pendulum.sign,
            "clock": pendulum.time,
            "colours": {
                "certified": CERTIFIED,
                "goal": GOAL,
                "pushed": PUSHED,
                "ink": MEASURED,
                "first": SERIES[0],
            },
            "content": self._content(),
        }

    @property
    def _centres(self) -> list[dict[str, str]]:
        """Point, name, colour and marker of the known centres of mass; no box if the hands replace it."""
        colours, marks = {**SEGMENTS, "whole body": SERIES[4], "box": SERIES[3]}, MARKS
        return [
            {**item, "colour": colours[item["name"]], "mark": marks[item["name"]]}
            for item in lift_data.centres(self.lift.body)
            if item["name"] != "box" or self.lift.facts.get("load_seen_by") != "hands"
        ]

    def _shorten(self, reason: str) -> str:
        """Return a reason why something is missing; the one for the deposit is long and repeated."""
        return "the deposit is not known" if reason == self.lift.facts["no_deposit"] else reason

    def _list_absent(self, failures: list[Failure]) -> str:
        """Return all parts that the lift lacks, each group with its reason; empty if it has all parts."""
        groups: dict[str, list[str]] = {}
        reasons = {
            EVENT_LABELS[name]: event["how"]
            for name, event in self.lift.events.items()
            if event["time_s"] is None
        }
        reasons |= {f"pendulum of the {item.com}": item.reason for item in failures}
        for part, reason in reasons.items():
            groups.setdefault(self._shorten(reason), []).append(part)
        return "; ".join(f"{', '.join(parts)} ({reason})" for reason, parts in groups.items())

    def _measures(self) -> list[dict[str, str]]:
        """Return name, value and safer direction of the headline measures; of those that the lift lacks, the reason."""

        def typeset(value: float, unit: str) -> str:
            value, unit = (1000 * value, "mm") if unit == "m" else (value, unit)
            return typeset_minus_signs(f"{value:.3g} {unit}")

        values = values_of_lift(self.course, self.lift.facts).drop_duplicates("measure")
        return [
            {
                "name": print_measure(row.measure),
                "reason": self._shorten(row.reason),
                "value": typeset(row.value, row.unit),
                "below": row.safer == "higher" and row.value < 0,
                "told": headline_sentence(row.measure, row.value, typeset(abs(row.value), row.unit)),
                "safer": row.safer,
                "meaning": MEASURES[row.measure].meaning,
                "phase": WINDOWS[MEASURES[row.measure].phase],
            }
            for row in values.itertuples()
            if MEASURES[row.measure].headline
        ]

    def _content(self) -> dict[str, Any]:
        """Return the data of the page's script."""
        facts, points = self.lift.facts, dict(points_of(self.lift.body))
        # The smallest and largest coordinate of the body and the ground.
        every = np.concatenate(list(points.values()))
        low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        low[2] = min(low[2], 0.0)
        # Name, start and end of every phase.
        time, phase = (self.lift.body[name].to_numpy() for name in ("time_s", "phase"))
        starts = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1)]
        ends = zip(starts, [*starts[1:], len(time) - 1], strict=True)
        return {
            "chains": stick_figure(points),
            "centres": self._centres,
            "segments": {com: {"colour": colour, "dash": DASHES[com]} for com, colour in SEGMENTS.items()},
            "phases": [(str(phase[i]), float(time[i]), float(time[j])) for i, j in ends],
            "deposit": None if facts["no_deposit"] else [facts["start_s"], facts["stop_s"]],
            "balance": bool(self._balance),
            "outlines": OUTLINES,
            "bounds": dict(zip("xyz", zip(low.tolist(), high.tolist(), strict=True), strict=True)),
            "shades": SHADES,
            "pendulums": {item.key: {**item.constants, "binds": item.binds} for item in self._pendulums[0]},
        }

    def to_html(self) -> str:
        """Return the page as one self-contained file: the same bytes for the same lift."""
        return one_file(_pictures(), PAGE, self.variables(), self._sources())

    def save(self, path: str | Path) -> None:
        """Write the page to a file."""
        write_text(Path(path), self.to_html())
