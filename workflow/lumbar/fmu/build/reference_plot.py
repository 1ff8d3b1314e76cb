"""The plot of an FMU's embedded reference as SVG text, for a page that must hold everything itself."""

from __future__ import annotations

import io

import numpy as np

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
    from matplotlib.figure import Figure

    with mpl.rc_context(_SETTINGS):
        figure = Figure(figsize=(6.6, 1.9 * len(panels)))
        # Fixed margins: a layout that is solved for differs in the last bit from run to run.
        figure.subplots_adjust(left=0.12, right=0.98, bottom=0.12, top=0.97, hspace=0.15)
        axes = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
        for axis, (label, values), colour in zip(axes, panels, _COLOURS, strict=True):
            axis.step(time, values, where="post", color=colour, linewidth=1.2)
            axis.set_ylabel(label)
        axes[-1].set_xlabel("Time (s)")
        text = io.StringIO()
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(text, format="svg", metadata=nothing)
    svg = text.getvalue()
    return svg[svg.index("<svg") :].rstrip()
