"""Equations as pictures that need no script and no font where they are shown."""

from __future__ import annotations

import html

import numpy as np

from lumbar.errors import InputError

_HEIGHT = 16
"""Height of a line of text in pixels."""
_GRID = 8
"""Points of the outlines lie on a grid of this many lines per pixel: whole numbers pack well."""
_MARGIN = 2 * _GRID
_LETTERS = {1: "m", 2: "l", 3: "q", 4: "c"}
"""SVG's letters for the path codes of matplotlib; with small letters points count from the one before."""
_CLOSE = 79


def equation_svg(latex: str) -> str:
    """Return an equation as an SVG element that HTML can hold.

    Parameters
    ----------
    latex : str
        In the part of LaTeX's mathematics that matplotlib sets; without dollar signs.

    Raises
    ------
    InputError
        If it cannot be set.
    """
    from matplotlib.textpath import TextPath

    try:
        path = TextPath((0, 0), f"${' '.join(latex.split())}$", size=_HEIGHT * _GRID)
    except ValueError as error:
        raise InputError(f"equation {latex!r} is not in LaTeX that can be set: {error}") from error
    # Pixels grow downwards.
    points = np.rint(path.vertices * (1, -1)).astype(int)
    left, top = points.min(axis=0) - _MARGIN
    width, height = points.max(axis=0) + _MARGIN - (left, top)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width / _GRID:g}" height="{height / _GRID:g}" '
        f'viewBox="{left} {top} {width} {height}"><title>{html.escape(latex)}</title>'
        f'<path d="{_commands(points, path.codes)}"/></svg>'
    )


def _commands(points: np.ndarray, codes: np.ndarray) -> str:
    """Outlines as SVG writes them, relative to the point before; a curve's points follow its letter."""
    parts, index, pen = [], 0, np.zeros(2, dtype=int)
    start = pen
    while index < len(codes):
        code = int(codes[index])
        if code == _CLOSE:
            parts.append("z")
            pen = start
            index += 1
            continue
        count = max(1, code - 1)
        steps = points[index : index + count] - pen
        parts.append(_LETTERS[code] + " ".join(map(str, steps.ravel())).replace(" -", "-"))
        pen = points[index + count - 1]
        start = pen if _LETTERS[code] == "m" else start
        index += count
    return "".join(parts)
