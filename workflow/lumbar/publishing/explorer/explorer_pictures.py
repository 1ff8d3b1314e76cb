"""Pictures of a diagnosis: measured and simulated output over time, loops, spectrum, and the error over the motion."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import (
    BasicTickFormatter,
    BoxAnnotation,
    ColorBar,
    ColumnDataSource,
    CustomJS,
    CustomJSHover,
    FixedTicker,
    HoverTool,
    LinearColorMapper,
    Model,
    Range1d,
    WheelZoomTool,
)
from bokeh.palettes import Blues256
from bokeh.plotting import figure

from lumbar.publishing.explorer.one_file import empty_source, plain_figure
from lumbar.publishing.explorer.page_data import PageModel, RecordData
from lumbar.publishing.figures.style import MEASURED, SERIES, WITH_EFFECTS
from lumbar.tissue.diagnosis.fitting.preparation import Experiment

MODEL, OTHER = WITH_EFFECTS["color"], SERIES[3]
"""Colours of the model and of the model compared with it, readable in grey: the first line is solid, the second dashed."""
NOISE = "#777777"
MARKED = SERIES[2]
SHOWN, CELLS, DEPTH, TURNS, SPECTRUM = "shown", "cells", "depth means", "turn means", "lines"
"""Names of the document's data sources for drawn data."""
BRUSHED, BRUSHED_LINES = "brushed", "brushed lines"
"""Names of the data sources for marked data."""
REQUEST, ANSWER = "request", "answer"
"""Names of the data sources for requests of the page and answers of the server."""
_COLUMNS = (
    *("time", "position", "velocity", "since", "measured", "model", "other"),
    *("model_error", "other_error", "model_turned", "other_turned"),
)
_MEANS = ("model_advancing", "model_retracting", "other_advancing", "other_retracting")
_HEIGHT = 230


def page_models(
    experiment: Experiment, records: Sequence[RecordData], models: Sequence[PageModel]
) -> tuple[list[Model], list[Model]]:
    """Return the pictures in the page's order, and the data sources that the page's script fills."""
    brushed = empty_source(BRUSHED, _COLUMNS)
    sources = []
    for record in records:
        errors = {model.key: model.errors[record.name] for model in models}
        sources.append(ColumnDataSource({**record.columns, **errors}, name=f"record:{record.name}"))
    for record in records:
        lines = {
            "frequency": record.frequency,
            "noise": np.full(len(record.frequency), np.nan) if record.noise is None else record.noise,
            "marker": record.marker,
            **{model.key: model.density[record.name] for model in models},
        }
        sources.append(ColumnDataSource(lines, name=f"spectrum:{record.name}"))
    sources += [brushed, empty_source(REQUEST, ("content",)), empty_source(ANSWER, ("content",))]
    return _pictures(experiment, brushed), sources


def _pictures(experiment: Experiment, brushed: ColumnDataSource) -> list[figure]:
    shown = empty_source(SHOWN, _COLUMNS)
    output = f"{experiment.output_quantity.capitalize()} ({experiment.output_unit})"
    position = f"{experiment.input_quantity.capitalize()} ({experiment.input_unit})"
    velocity = f"Velocity ({experiment.input_unit}/s)"
    error = f"Error ({experiment.output_unit})"
    # Ranges are set by the page's script. A drag moves the time that is shown, the wheel with Ctrl changes its length.
    over_time = _figure("course", "Time (s)", output, x_range=Range1d(0, 1))
    over_time.xaxis.visible = False
    for end in ("start", "end"):
        over_time.x_range.js_on_change(end, CustomJS(code="window.lumbar.moved()"))
    residual = _figure("residual", "Time (s)", error, x_range=over_time.x_range, y_range=Range1d(-1, 1))
    for picture in (over_time, residual):
        picture.sizing_mode, picture.toolbar.tools = "stretch_both", []
        picture.add_tools("xpan", WheelZoomTool(dimensions="width", modifiers="ctrl"))
        picture.yaxis.ticker.desired_num_ticks = 4
    loop = _figure("loop", position, output)
    plane = _figure("plane", position, velocity, x_range=loop.x_range)
    depth = _figure("depth", position, error, x_range=loop.x_range)
    along = f"Error along the motion ({experiment.output_unit})"
    turns = _figure("turns", "Time after the nearest reversal (s)", along)
    lines = {
        over_time: ("time", ("measured", "other", "model")),
        residual: ("time", ("other_error", "model_error")),
        loop: ("position", ("measured", "other", "model")),
    }
    if experiment.floor is not None:
        rms = experiment.floor.rms  # the noise
        residual.add_layout(BoxAnnotation(bottom=-rms, top=rms, fill_color=NOISE, fill_alpha=0.25))
    for picture, (across, ups) in lines.items():
        for up in ups:
            picture.line(across, up, source=shown, **_line(up))
        _add_hover(picture, across, ups, shown)
    _draw_cells(plane, error)
    _draw_means(depth, empty_source(DEPTH, ("position", *_MEANS)), "position", _MEANS)
    _draw_means(turns, empty_source(TURNS, ("since", "model", "other")), "since", ("other", "model"))
    for picture, across, up in (
        (over_time, "time", "measured"),
        (residual, "time", "model_error"),
        (loop, "position", "measured"),
        (plane, "position", "velocity"),
        (depth, "position", "model_error"),
        (turns, "since", "model_turned"),
    ):
        picture.scatter(across, up, source=brushed, size=4, color=MARKED, alpha=0.6)
        _call_on_selection(picture, f"window.lumbar.brush('{across}', '{up}', cb_obj)")
    return [over_time, residual, loop, plane, depth, turns, _spectrum(experiment)]


def _call_on_selection(picture: figure, script: str) -> None:
    """Call the page's script after the user draws a box in a picture."""
    picture.js_on_event("selectiongeometry", CustomJS(code=script))


def _line(column: str) -> dict:
    curve = column.partition("_")[0]  # the page's script switches it by this name
    looks = {
        "measured": {"color": MEASURED, "line_width": 1.2},
        "model": {"color": MODEL, "line_width": 1.8},
        "other": {"color": OTHER, "line_width": 1.4, "line_dash": [6, 3]},
    }
    return {"name": curve, **looks[curve]}


def _add_hover(picture: figure, across: str, ups: Sequence[str], source: ColumnDataSource) -> None:
    """Show the values of all curves at the pointer, by an invisible line even if curves are switched off."""
    carrier = "measured" if "measured" in ups else ups[-1]
    unseen = picture.line(across, carrier, source=source, color=MODEL, alpha=0)
    digits = CustomJSHover(code="return Number.isFinite(value) ? value.toPrecision(4) : '–'")
    names = (across, *ups)
    tooltips = [(name.replace("_", " "), f"@{name}{{custom}}") for name in names]
    formatters = {f"@{name}": digits for name in names}
    mode = "mouse" if picture.name == "loop" else "vline"  # a loop passes a depth more than once
    hover = HoverTool(renderers=[unseen], tooltips=tooltips, formatters=formatters, mode=mode)
    picture.add_tools(hover)


def _figure(name: str, across: str, up: str, **more) -> figure:
    tools = {"tools": "box_select", "toolbar_location": None}
    return plain_figure(name, across, up, height=_HEIGHT, left=70, **tools, **more)


def _draw_means(picture: figure, source: ColumnDataSource, across: str, columns: Sequence[str]) -> None:
    """Draw mean errors of both models; markers point in the direction of motion."""
    for column in columns:
        look = _line(column)
        picture.line(across, column, source=source, **look)
        mark = "inverted_triangle" if column.endswith("retracting") else "triangle"
        if column in _MEANS:
            how = {"marker": mark, "size": 6, "color": look["color"], "name": look["name"]}
            picture.scatter(across, column, source=source, **how)
    _add_hover(picture, across, columns, source)


def _draw_cells(plane: figure, error: str) -> None:
    """Draw the RMS of the model's error in cells of position and velocity."""
    cells = empty_source(CELLS, ("position", "velocity", "width", "height", "rms"))
    light_to_dark = list(reversed(Blues256))[16:]  # one hue: the order survives in grey
    mapper = LinearColorMapper(palette=light_to_dark, low=0, high=1, name="shading")
    fill = {"field": "rms", "transform": mapper}
    plane.rect("position", "velocity", "width", "height", source=cells, fill_color=fill, line_color=None)
    plane.add_tools(HoverTool(tooltips=[(error, "@rms{0.0000}"), ("position", "$x"), ("velocity", "$y")]))
    plane.add_layout(ColorBar(color_mapper=mapper, title=f"{error}, RMS", width=8), "right")


def _spectrum(experiment: Experiment) -> figure:
    spectrum = empty_source(SPECTRUM, ("frequency", "noise", "marker", "model", "other"))
    up, logarithmic = f"Error ({experiment.output_unit}/√Hz)", {"x_axis_type": "log", "y_axis_type": "log"}
    picture = _figure("spectrum", "Frequency (Hz)", up, **logarithmic)
    # Below two decades Bokeh takes the steps of a linear axis: crowded above, no label below.
    steps = FixedTicker(ticks=[digit * 10.0**power for power in range(-9, 10) for digit in (1, 3)])
    picture.yaxis.ticker = picture.ygrid.ticker = steps
    picture.yaxis.formatter = BasicTickFormatter(use_scientific=False)
    picture.line("frequency", "noise", source=spectrum, color=NOISE, line_width=3, alpha=0.6)
    picture.scatter("frequency", "model", source=spectrum, marker="marker", size=5, color=MODEL, name="model")
    curves = ("other", "model")
    for curve in curves:
        picture.line("frequency", curve, source=spectrum, **_line(curve) | {"line_width": 1.4})
    _add_hover(picture, "frequency", curves, spectrum)
    marked = empty_source(BRUSHED_LINES, ("frequency", "density"))
    picture.line("frequency", "density", source=marked, color=MARKED, line_width=3, alpha=0.7)
    _call_on_selection(picture, "window.lumbar.brushBand(cb_obj)")
    return picture
