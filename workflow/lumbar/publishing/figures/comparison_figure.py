"""A simulation beside the measurement, and how much of every record's variance it leaves."""

from __future__ import annotations

import numpy as np

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    MODELS,
    house_style,
    label_panels,
    new_figure,
)
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.residuals.compare import Comparison

_SHOWN = 500
"""Samples of the segment that is shown by default."""
_NOISE = {"color": "#bbbbbb", "edgecolor": "#555555", "linewidth": 0.6}


def default_segment(record: Record, simulated: np.ndarray, start: float) -> tuple[float, float]:
    """Seconds of a segment in which the error is as large as it is on the whole record."""
    first, size = round(start / record.sampling_time), min(_SHOWN, len(record) // 2)
    energy = np.cumsum(np.insert((record["output"] - simulated) ** 2, 0, 0.0))
    candidates = np.arange(first, len(record) - size, max(size // 4, 1))
    if not candidates.size:
        return float(record.time[first]), float(record.time[-1])
    mean = (energy[candidates + size] - energy[candidates]) / size
    chosen = candidates[np.argmin(np.abs(mean - np.median(mean)))]
    return float(record.time[chosen]), float(record.time[chosen + size])


@house_style
def comparison_figure(
    record: Record,
    simulated: np.ndarray,
    comparisons: list[Comparison],
    model: str = "KB",
    segment: tuple[float, float] | None = None,
):
    """Draw a segment of one record with its residual, and what the model leaves of every record's variance.

    Parameters
    ----------
    record : Record
        Channels ``input`` and ``output``; one of the compared records.
    simulated : numpy.ndarray, shape (samples,)
        Free run over the record.
    comparisons : list of Comparison
        Of all records, this one among them.
    model : str
        Name of the model as it is to stand in the legend.
    segment : (float, float), optional
        Seconds; default a stretch whose error is typical.

    Returns
    -------
    matplotlib.figure.Figure
    """
    mine = next(item for item in comparisons if item.record == record.name)
    low, high = segment or default_segment(record, simulated, mine.start)
    inside = (record.time >= low - 1e-9) & (record.time <= high + 1e-9)
    figure, axes = new_figure(
        DOUBLE_COLUMN, 3.4, nrows=2, ncols=2, width_ratios=(1.9, 1), height_ratios=(1.7, 1), sharex="col"
    )
    response, residual = axes[:, 0]
    grid = axes[0, 1].get_gridspec()
    for axis in axes[:, 1]:
        axis.remove()
    shares = figure.add_subplot(grid[:, 1])
    look = MODELS.get(model.split("+")[0], MODELS["KB"])
    output, time = record.channels["output"], record.time[inside]
    response.plot(time, output.values[inside], color=MEASURED, linewidth=0.9, label="measured")
    response.plot(
        time,
        simulated[inside],
        color=look["color"],
        linestyle=(0, (4, 1.2)),
        linewidth=1.4,
        label=f"{model}, free run",
    )
    response.set_ylabel(output.label)
    response.set_title(record.name.replace("_", " "))
    response.legend(loc="upper right", ncols=2)
    bottom, top = response.get_ylim()
    response.set_ylim(bottom, top + 0.18 * (top - bottom))
    _draw_residual(residual, time, (output.values - simulated)[inside], mine, look)
    residual.set_xlim(low, high)
    _draw_shares(shares, comparisons)
    label_panels([response, shares, residual])
    return figure


def _draw_residual(axis, time: np.ndarray, values: np.ndarray, comparison: Comparison, look: dict) -> None:
    if comparison.floor is not None:
        band = 2 * comparison.floor.rms
        axis.axhspan(-band, band, color="#cccccc", linewidth=0, label="± 2 × noise floor")
    axis.plot(time, values, color=look["color"], linewidth=0.8)
    axis.set_ylabel(f"Measured − model\n({comparison.unit})")
    axis.set_xlabel("Time (s)")
    if comparison.floor is not None:
        bottom, top = axis.get_ylim()
        axis.set_ylim(bottom, top + 0.25 * (top - bottom))
        axis.legend(loc="upper right")


def _draw_shares(axis, comparisons: list[Comparison]) -> None:
    """Bars of what is left of the output's variance: explainable and noise."""
    left = np.array([100 * item.rms.value**2 / item.output_variance for item in comparisons])
    reach = np.array(
        [
            [100 * (item.rms.value**2 - item.rms.low**2) / item.output_variance for item in comparisons],
            [100 * (item.rms.high**2 - item.rms.value**2) / item.output_variance for item in comparisons],
        ]
    )
    places = np.arange(len(comparisons))
    known = comparisons[0].floor is not None
    if known:
        explainable = np.array([item.explainable_percent for item in comparisons])
        axis.bar(places, left - explainable, 0.55, label="noise", **_NOISE)
        axis.bar(
            places,
            explainable,
            0.55,
            bottom=left - explainable,
            color="white",
            edgecolor=MODELS["HO"]["color"],
            hatch="////",
            linewidth=0.8,
            label="explainable",
        )
    else:
        axis.bar(places, left, 0.55, label="noise and error of the model", **_NOISE)
    axis.errorbar(places, left, np.maximum(reach, 0), fmt="none", color="black", capsize=2, linewidth=0.8)
    highest = float((left + reach[1]).max())
    for place, item, total, upper in zip(places, comparisons, left, reach[1], strict=True):
        axis.annotate(
            f"VAF\n{item.vaf.value:.4g} %",
            (place, total + upper),
            (0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=6.5,
        )
    axis.set_ylim(0, 1.3 * highest)
    axis.set_xlim(-0.6, len(comparisons) - 0.4)
    axis.set_xticks(places, [item.record.replace("_", " ") for item in comparisons])
    if max(len(item.record) for item in comparisons) * len(comparisons) > 30:
        axis.tick_params(axis="x", labelrotation=30)
    axis.set_ylabel("Left of the output's variance (%)")
    axis.grid(visible=False, axis="x")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    axis.set_ylim(0, 1.45 * highest)
