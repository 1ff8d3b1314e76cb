"""Equations as pictures: matplotlib's mathtext, readable in a page without a network."""

from __future__ import annotations

import io

_SIZE = 11
_POINTS_PER_INCH = 72.0
_SAME_BYTES = {"svg.hashsalt": "lumbar", "svg.fonttype": "path"}


def equation_svg(latex: str, size: float = _SIZE) -> str:
    """Return an equation as SVG text.

    Parameters
    ----------
    latex : str
        What mathtext knows of LaTeX, without dollar signs.
    size : float
        Points.

    Raises
    ------
    ValueError
        If mathtext cannot read it.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.mathtext import MathTextParser

    text, font = f"${latex}$", FontProperties(size=size)
    width, height, depth, *_ = MathTextParser("path").parse(text, dpi=_POINTS_PER_INCH, prop=font)
    height += 2.0
    figure = Figure(figsize=((width + 2.0) / _POINTS_PER_INCH, height / _POINTS_PER_INCH))
    figure.text(0, (depth + 1.0) / height, text, fontproperties=font)
    stream = io.StringIO()
    with rc_context(_SAME_BYTES):
        figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    return stream.getvalue()
