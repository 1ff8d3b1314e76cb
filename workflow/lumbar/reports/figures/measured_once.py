"""Ticks and text of a figure that is finished, found out once: matplotlib asks for them dozens of times until it is saved."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

from matplotlib.axis import Axis
from matplotlib.text import Text


@contextmanager
def measured_once() -> Iterator[None]:
    """Keep which ticks an axis shows while it keeps its size and limits, and how large a text is while it says the same.

    Within it nothing else of a figure may be changed. The files stay the same, byte for byte.
    """
    ticks: dict = {}
    layouts: dict = {}

    def update_ticks(axis, update=Axis._update_ticks):
        dpi = axis.get_figure(root=True).dpi
        at = (*axis.get_view_interval(), *axis.axes.bbox.bounds, dpi)
        if axis not in ticks or ticks[axis][0] != at:  # they stand where they were put last
            ticks[axis] = at, update(axis)
        return ticks[axis][1]

    def get_layout(text, renderer, measure=Text._get_layout):
        alignment = text.get_horizontalalignment(), text.get_verticalalignment(), text.get_rotation()
        at = (text, text.get_text(), *alignment, renderer, text.get_figure(root=True).dpi)
        if at not in layouts:
            layouts[at] = measure(text, renderer)
        return layouts[at]

    with (
        mock.patch.object(Axis, "_update_ticks", update_ticks),
        mock.patch.object(Text, "_get_layout", get_layout),
    ):
        yield
