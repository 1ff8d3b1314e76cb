"""A static curve between linear filters: what either filter lets through, and the curve over all that came to it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    SERIES,
    house_style,
    label_panels,
    new_figure,
    say_instead,
)
from lumbar.tissue.diagnosis.law.block_structure import BlockStructure, Filter
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.models.motion import JoinedMotions

_LINES, _DECADES = 400, 3
_DRAWN = 400
_BARS = 40


@house_style
def chain_figure(found: Verdict) -> Figure:
    """Draw a verdict's chain in the order in which a signal passes it: filter, curve, filter."""
    chain, experiment = found.chain, found.experiment
    figure, (front, curve, back) = new_figure(DOUBLE_COLUMN, 2.4, ncols=3)
    _draw_filter(front, chain.front, chain.sampling_time, "in front")
    _draw_filter(back, chain.back, chain.sampling_time, "behind")
    _draw_curve(curve, chain, found)
    label_panels((front, curve, back))
    before = f"{'' if chain.front.is_static else 'filtered '}{experiment.input_quantity}"
    after = f"{'' if chain.back.is_static else 'unfiltered '}{experiment.output_quantity}"
    curve.set_xlabel(f"{before.capitalize()} ({experiment.input_unit})")
    curve.set_ylabel(f"{after.capitalize()} ({experiment.output_unit})")
    return figure


def _draw_filter(axis, filter_: Filter, step: float, place: str) -> None:
    axis.set_xlabel("Frequency (Hz)")
    axis.set_ylabel(f"Gain of the filter {place}")
    if filter_.is_static:
        say_instead(axis, f"no filter {place}")
        return
    highest = 0.5 / step
    frequency = np.geomspace(highest / 10**_DECADES, highest, _LINES)
    axis.loglog(frequency, np.abs(filter_.response(2 * np.pi * frequency * step)), color=SERIES[0])


def _draw_curve(axis, chain: BlockStructure, found: Verdict) -> None:
    motion = found.experiment.training.motion
    parts = motion.parts if isinstance(motion, JoinedMotions) else (motion,)
    inner = np.concatenate([chain.front.apply(part.position) for part in parts])
    low, high = chain.curve.knots[[0, -1]]
    drawn = np.linspace(low, high, _DRAWN)
    count, edges = np.histogram(inner, _BARS)
    values = chain.curve.apply(drawn)
    height = 0.25 * np.ptp(values) * count / count.max()
    axis.bar(
        edges[:-1],
        height,
        np.diff(edges),
        values.min(),
        align="edge",
        color="#cccccc",
        label="how often (training)",
    )
    axis.plot(drawn, values, color=SERIES[3], label="curve")
    axis.legend(loc="upper left" if values[-1] > values[0] else "upper right")
