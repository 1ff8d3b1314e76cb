"""A plot of a few lines over time as SVG text, for pages that must hold everything themselves."""

from __future__ import annotations

import html
import math

import numpy as np

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 640, 180, 70, 15, 24, 40
_COLOURS = ("#000000", "#0072B2", "#D55E00")


def svg_plot(time: np.ndarray, panels: list[tuple[str, np.ndarray]]) -> str:
    """Return an SVG element: one panel per signal above another, with a common time axis in seconds.

    Parameters
    ----------
    time : numpy.ndarray, shape (samples,)
    panels : list of tuple
        Axis label and values, shape (samples,); drawn as steps, as they are held between samples.
    """
    drawn = [
        _panel(time, label, values, index * _HEIGHT, _COLOURS[index % len(_COLOURS)])
        for index, (label, values) in enumerate(panels)
    ]
    height = _HEIGHT * len(panels)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{height}" '
        f'viewBox="0 0 {_WIDTH} {height}" font-family="sans-serif" font-size="12">\n'
        + "".join(drawn)
        + "</svg>"
    )


def _panel(time: np.ndarray, label: str, values: np.ndarray, top: float, colour: str) -> str:
    left, right = _LEFT, _WIDTH - _RIGHT
    upper, lower = top + _TOP, top + _HEIGHT - _BOTTOM
    low, high = float(values.min()), float(values.max())
    if high == low:
        low, high = low - 1.0, high + 1.0
    x = left + (time - time[0]) / (time[-1] - time[0]) * (right - left)
    y = lower - (values - low) / (high - low) * (lower - upper)
    points = " ".join(
        f"{a:.1f},{b:.1f} {after:.1f},{b:.1f}" for a, b, after in zip(x, y, [*x[1:], x[-1]], strict=True)
    )
    digits = 2 - math.floor(math.log10(high - low))
    ticks = "".join(
        f'<text x="{left - 6}" y="{place:.1f}" text-anchor="end" dominant-baseline="middle">{round(value, digits):g}</text>'
        for value, place in ((low, lower), (high, upper))
    ) + "".join(
        f'<text x="{place}" y="{lower + 16}" text-anchor="middle">{value:.3g}</text>'
        for value, place in ((time[0], left), (time[-1], right))
    )
    return (
        f'<rect x="{left}" y="{upper}" width="{right - left}" height="{lower - upper}" fill="none" stroke="#999"/>\n'
        f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>\n{ticks}\n'
        f'<text x="{(left + right) / 2}" y="{lower + 30}" text-anchor="middle">Time (s)</text>\n'
        f'<text x="{left}" y="{upper - 8}">{html.escape(label)}</text>\n'
    )
