"""Equations as pictures that need no script and no font where they are shown."""

from __future__ import annotations

import html

import numpy as np

from lumbar.base.errors import InputError

_HEIGHT = 16
"""Height of a line of text in pixels."""
_GRID = 8
"""Points of the outlines lie on a grid of this many lines per pixel: whole numbers pack well."""
_MARGIN = 2 * _GRID
_LETTERS = {2: "l", 3: "q", 4: "c"}
"""SVG's letters for the path codes of matplotlib, which are one more than a code has points."""
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
    points = path.vertices * (1, -1)  # pixels grow downwards
    left, top = np.floor(points.min(axis=0)).astype(int) - _MARGIN
    width, height = np.ceil(points.max(axis=0)).astype(int) + _MARGIN - (left, top)
    starts = np.flatnonzero(path.codes == path.MOVETO)
    outlines = zip(np.split(points, starts[1:]), np.split(path.codes, starts[1:]), strict=True)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width / _GRID:g}" height="{height / _GRID:g}" '
        f'viewBox="{left} {top} {width} {height}"><title>{html.escape(latex)}</title>'
        f'<path d="{"".join(_outline(*outline) for outline in outlines)}"/></svg>'
    )


def _outline(points: np.ndarray, codes: np.ndarray) -> str:
    """One closed line as SVG writes it.

    Points are rounded relative to the first one and count from the one before: the same letter is then the same text
    wherever it stands, which packs well.
    """
    x, y = np.rint(points[0]).astype(int)
    offsets = np.rint(points - points[0]).astype(int)
    parts, index = [f"M{x} {y}"], 1
    while codes[index] != _CLOSE:
        last = index + int(codes[index]) - 2
        steps = offsets[index : last + 1] - offsets[index - 1]
        parts.append(_LETTERS[int(codes[index])] + " ".join(map(str, steps.ravel())).replace(" -", "-"))
        index = last + 1
    return "".join([*parts, "z"])
