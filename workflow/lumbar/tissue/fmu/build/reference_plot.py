"""The plot of an FMU's embedded reference as SVG text, for a page that must hold everything itself."""

from __future__ import annotations

import io
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_SETTINGS = {
    "figure.constrained_layout.use": False,
    "font.size": 9,
    "svg.hashsalt": "lumbar",
    "svg.fonttype": "path",
}
_COLOURS = ("#000000", "#0072B2")


def reference_plot(time: np.ndarray, panels: list[tuple[str, np.ndarray]]) -> str:
    """Return an SVG element, byte for byte the same at every run: one panel per signal, a common axis of time.

    Parameters
    ----------
    time : numpy.ndarray, shape (samples,)
        Seconds.
    panels : list of tuple
        Axis label and values, shape (samples,); drawn as steps, as they are held between samples.
    """
    import matplotlib as mpl

    with mpl.rc_context(_SETTINGS):
        figure, axes, lines = _panels(len(panels))
        for axis, line, (label, values) in zip(axes, lines, panels, strict=True):
            line.set_data(time, values)
            axis.set_ylabel(label)
            axis.relim()
            axis.autoscale_view()
        text = io.StringIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", metadata=nothing)
    svg = text.getvalue()
    return svg[svg.index("<svg") :].rstrip()


@cache
def _panels(count: int) -> tuple[Figure, list[Axes], list[Line2D]]:
    """Figure, axes and lines, made once: making them and their ticks takes longer than drawing."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6, 1.9 * count))
    # Fixed margins: a layout that is solved for differs in the last bit from run to run.
    figure.subplots_adjust(left=0.12, right=0.98, bottom=0.12, top=0.97, hspace=0.15)
    axes = list(figure.subplots(count, sharex=True, squeeze=False)[:, 0])
    axes[-1].set_xlabel("Time (s)")
    lines = [
        axis.step([], [], where="post", color=colour, linewidth=1.2)[0]
        for axis, colour in zip(axes, _COLOURS, strict=True)
    ]
    return figure, axes, lines
