"""Models beside measurements: a simulation and how much of every record it explains, the error ladder, effects' signatures."""

from __future__ import annotations

import numpy as np

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    MODELS,
    SERIES,
    SINGLE_COLUMN,
    house_style,
    label_panels,
    new_figure,
    svg_text,
)
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.residuals.compare import Comparison
from lumbar.tissue.diagnosis.selection.verdict import distinguishing_digits
from lumbar.tissue.effects.signature import RATES, Signature, pictured_form, signatures
from lumbar.tissue.models.form import Effect

_SHOWN_SAMPLES = 500
"""Samples of the segment that is shown by default."""
_NOISE = {"color": "#bbbbbb", "edgecolor": "#555555", "linewidth": 0.6}


def default_segment(record: Record, simulated: np.ndarray, start: float) -> tuple[float, float]:
    """Seconds of a segment in which the error is as large as it is on the whole record."""
    first, size = round(start / record.sampling_time), min(_SHOWN_SAMPLES, len(record) // 2)
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


@house_style
def ladder_figure(rungs: list[dict], unit: str, floor: float | None):
    """Draw training and unseen error of every rung, and the noise floor.

    Parameters
    ----------
    rungs : list of dict
        ``label``, ``train_rms`` and ``test_rms`` of base, base and first effect, ….
    unit : str
        Of the errors.
    floor : float or None
        Noise floor, where it is known.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(SINGLE_COLUMN, 2.6)
    places = range(len(rungs))
    style = MODELS["KB"]
    axes.bar(
        [place - 0.19 for place in places],
        [rung["train_rms"] for rung in rungs],
        0.36,
        color=style["color"],
        alpha=0.45,
        label="training record",
    )
    axes.bar(
        [place + 0.19 for place in places],
        [rung["test_rms"] for rung in rungs],
        0.36,
        color=style["color"],
        hatch="//",
        edgecolor="white",
        label="unseen records",
    )
    for shift, key in ((-0.19, "train_rms"), (0.19, "test_rms")):
        words = distinguishing_digits([rung[key] for rung in rungs], 2)
        for place, rung, told in zip(places, rungs, words, strict=True):
            axes.annotate(
                told,
                (place + shift, rung[key]),
                (0, 1),
                textcoords="offset points",
                ha="center",
                size=6,
            )
    if floor is not None:
        axes.axhline(floor, color="black", linestyle="--", linewidth=0.9, label="noise floor")
    smallest = min(
        [rung[key] for rung in rungs for key in ("train_rms", "test_rms")] + ([floor] if floor else [])
    )
    largest = max(rung[key] for rung in rungs for key in ("train_rms", "test_rms"))
    if largest > 8 * smallest:
        axes.set_yscale("log")
        axes.set_ylim(0.5 * smallest, 2.2 * largest)
    else:
        axes.set_ylim(0, 1.25 * largest)
    axes.set_xticks(list(places), [rung["label"] for rung in rungs])
    axes.set_ylabel(f"RMS of the simulation error ({unit})")
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def ladder_rungs(diagnosis: dict) -> list[dict]:
    """Return the rungs of a ``diagnosis.json`` with labels for the figure."""
    rungs, before = [], 0
    for rung in diagnosis["ladder"]:
        added = rung["effects"][before:]
        label = diagnosis["base"] if not rung["effects"] else "+ " + " and ".join(added).replace("_", "\n")
        rungs.append({"label": label, "train_rms": rung["train_rms"], "test_rms": rung["test_rms"]})
        before = len(rung["effects"])
    return rungs


_SHOWN_S = 8.0
"""Seconds shown over time."""
_BASE = {"color": "#999999", "linestyle": (0, (4, 1.5)), "linewidth": 1.0}


_AXES = {"tissue": ("Position", "force"), "pendulum": ("Angle", "moment")}


@house_style
def signature_figure(effects: list[Effect], system: str = "tissue"):
    """Draw one row per effect: force over position, added force over position at two rates, added force over time.

    Parameters
    ----------
    effects : list of Effect
        Each is drawn in the form of `lumbar.tissue.effects.signature.pictured_form`.
    system : str
        What they are effects of: ``tissue`` or ``pendulum``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 0.25 + 1.75 * len(effects), nrows=len(effects), ncols=3, squeeze=False
    )
    for row, effect in zip(axes, effects, strict=True):
        _draw_effect(row, effect, system)
    return figure


@house_style
def signature_thumbnail(effect: Effect, system: str = "tissue") -> str:
    """Small picture of one effect: force over position on a standard motion, with it and without, as the text of an SVG."""
    form = pictured_form(effect)
    slow, _ = signatures(effect, form, system)
    figure, axes = new_figure(2.2, 1.4)
    cycle = _last_cycle(slow, RATES[0])
    axes.plot(slow.motion.position[cycle], slow.base[cycle], **_BASE)
    axes.plot(slow.motion.position[cycle], slow.force[cycle], color=SERIES[3], linewidth=1.2)
    axes.set_xlabel(_AXES[system][0])
    axes.set_ylabel(_AXES[system][1].capitalize())
    axes.set_xticks([])
    axes.set_yticks([])
    return svg_text(figure)


def _draw_effect(row, effect: Effect, system: str) -> None:
    form = pictured_form(effect)
    slow, fast = signatures(effect, form, system)
    moved, response = _AXES[system]
    whole, added, course = row
    settled, cycle = slow.motion.time >= 2 / RATES[0], _last_cycle(slow, RATES[0])
    whole.plot(slow.motion.position[cycle], slow.base[cycle], label=system, **_BASE)
    whole.plot(slow.motion.position[settled], slow.force[settled], color=SERIES[0], label="with the effect")
    whole.set_ylabel(response.capitalize())
    whole.set_title(effect.name.replace("_", " "), loc="left", fontweight="bold")
    styles = ((slow, RATES[0], SERIES[0], "-"), (fast, RATES[1], SERIES[3], (0, (3, 1))))
    for item, rate, color, line in styles:
        kept = _last_cycle(item, rate)
        added.plot(
            item.motion.position[kept],
            item.added_force[kept],
            color=color,
            linestyle=line,
            linewidth=1.0,
            label=f"{rate:g} Hz",
        )
    added.set_ylabel(f"Added {response}")
    added.set_title(f"${form.latex}$", loc="left")
    for axis in (whole, added):
        axis.set_xlabel(moved)
    _draw_course(course, slow, moved.lower(), response)
    for axis in row:
        _room(axis)
        axis.legend(
            loc="upper left", ncols=2, handlelength=1.4, columnspacing=0.8, borderpad=0.1, fontsize=6.5
        )
        axis.tick_params(labelsize=6.5)


def _last_cycle(item: Signature, rate: float) -> np.ndarray:
    """Samples of the motion's last cycle, its end included."""
    return np.arange(len(item.motion)) >= len(item.motion) - 1 - round(1 / (rate * item.motion.sampling_time))


def _draw_course(axis, item: Signature, moved: str, response: str) -> None:
    shown = item.motion.time <= _SHOWN_S
    scale = np.abs(item.added_force[shown]).max() / np.abs(item.motion.position).max()
    axis.plot(item.motion.time[shown], scale * item.motion.position[shown], label=f"{moved}, scaled", **_BASE)
    axis.plot(
        item.motion.time[shown],
        item.added_force[shown],
        color=SERIES[0],
        linewidth=1.0,
        label=f"added {response}",
    )
    axis.set_xlabel("Time (s)")


def _room(axis) -> None:
    bottom, top = axis.get_ylim()
    axis.set_ylim(bottom, top + 0.22 * (top - bottom))
