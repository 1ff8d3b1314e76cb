"""Figures of simulations with measurements, explained shares of records, error ladders, and signatures of effects."""

from collections.abc import Sequence
from itertools import pairwise
from string import ascii_lowercase

import numpy as np
from matplotlib.figure import Figure

from lumbar.base.formats import format_number
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    MODELS,
    SERIES,
    SINGLE_COLUMN,
    WITH_EFFECTS,
    add_head_room,
    house_style,
    label_panels,
    mark_noise_floor,
    new_figure,
    note,
    show_placeholder,
)
from lumbar.records.record import Record
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.residuals.compare import Comparison
from lumbar.tissue.diagnosis.selection.candidate import Candidate
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits
from lumbar.tissue.effects.signature import AXES, RATES, pictured_form, signatures
from lumbar.tissue.models.form import Effect

_SEGMENT_SAMPLES = 500
"""Number of samples in the default segment."""
_NOISE_STYLE = {"color": "#bbbbbb", "edgecolor": "#555555", "linewidth": 0.6}
_EXPLAINABLE_STYLE = {"color": "white", "edgecolor": MODELS["HO"]["color"], "hatch": "////", "linewidth": 0.8}


def default_segment(record: Record, simulated: np.ndarray, start: float) -> tuple[float, float]:
    """Return start and end in s of a segment with the median error of all segments of the record."""
    first, size = round(start / record.sampling_time), min(_SEGMENT_SAMPLES, len(record) // 2)
    energy = np.cumsum(np.insert((record["output"] - simulated) ** 2, 0, 0.0))
    candidates = np.arange(first, len(record) - size, max(size // 4, 1))
    if not candidates.size:
        return float(record.time[first]), float(record.time[-1])
    mean = (energy[candidates + size] - energy[candidates]) / size
    chosen = candidates[np.argmin(np.abs(mean - np.median(mean)))]
    return float(record.time[chosen]), float(record.time[chosen + size])


@house_style
def record_comparison_figure(
    record: Record,
    simulated: np.ndarray,
    comparisons: list[Comparison],
    model: str = "KB",
) -> Figure:
    """Draw a typical segment of one record with its residual, and the unexplained share of every record's variance.

    `simulated` is the free run over `record`, shape (samples,); `comparisons` has one comparison per record, with
    `record` among them; `model` is the name in the legend.
    """
    mine = next(item for item in comparisons if item.record == record.name)
    segment = default_segment(record, simulated, mine.start)
    ratios = {"width_ratios": (1.9, 1), "height_ratios": (1.7, 1)}
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, nrows=2, ncols=2, sharex="col", **ratios)
    response, residual = axes[:, 0]
    grid = axes[0, 1].get_gridspec()
    for axis in axes[:, 1]:
        axis.remove()
    shares = figure.add_subplot(grid[:, 1])
    draw_segment((response, residual), record, simulated, mine, segment, model)
    output = record.channels["output"]
    label = f"{output.quantity.capitalize()} ({unit_in_print(output.unit)})"
    response.set_ylabel(label)
    figure.legend(*response.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    residual.set_xlim(segment)
    _draw_shares(shares, comparisons)
    label_panels([response, shares, residual])
    response.set_title(record.name.replace("_", " "))
    return figure


def draw_segment(
    axes,
    record: Record,
    simulated: np.ndarray,
    comparison: Comparison,
    segment: tuple[float, float],
    model: str,
) -> None:
    """Draw measured and simulated output over a segment in s, and the residual with the noise floor."""
    response, residual = axes
    inside = (record.time >= segment[0] - 1e-9) & (record.time <= segment[1] + 1e-9)
    time, measured, modelled = record.time[inside], record["output"][inside], simulated[inside]
    base, *effects = model.split("+")
    color = (WITH_EFFECTS if effects else MODELS.get(base.split()[-1], MODELS["KB"]))["color"]
    response.plot(time, measured, color=MEASURED, linewidth=0.9, label="measured")
    dashed = {"linestyle": (0, (4, 1.2)), "linewidth": 1.4}
    response.plot(time, modelled, color=color, label=f"{model.replace('_', ' ')}, free run", **dashed)
    if comparison.floor is not None:
        band = 2 * comparison.floor.rms
        residual.axhspan(-band, band, color="#cccccc", linewidth=0, label="± 2 × noise floor")
    residual.plot(time, measured - modelled, color=color, linewidth=0.8)
    residual.set(ylabel=f"Measured − model\n({unit_in_print(comparison.unit)})", xlabel="Time (s)")
    if comparison.floor is not None:
        residual.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), borderaxespad=0, borderpad=0.1)


def _draw_shares(axis, comparisons: list[Comparison]) -> None:
    """Draw the unexplained shares of the output's variance: explainable and noise."""
    left, low, high = (
        np.array([100 * getattr(item.rms, name) ** 2 / item.output_variance for item in comparisons])
        for name in ("value", "low", "high")
    )
    bars = np.maximum([left - low, high - left], 0)
    places = np.arange(len(comparisons))
    if comparisons[0].floor is not None:
        explainable = np.array([item.explainable_percent for item in comparisons])
        axis.bar(places, left - explainable, 0.55, label="noise", **_NOISE_STYLE)
        axis.bar(
            places, explainable, 0.55, bottom=left - explainable, label="explainable", **_EXPLAINABLE_STYLE
        )
    else:
        axis.bar(places, left, 0.55, label="noise and error of the model", **_NOISE_STYLE)
    axis.errorbar(places, left, bars, fmt="none", color="black", capsize=2, linewidth=0.8)
    for place, item, top in zip(places, comparisons, high, strict=True):
        note(
            axis,
            f"VAF\n{format_number(item.vaf.value, 4)} %",
            (place, top),
            (0, 3),
            ha="center",
            fontsize=6.5,
        )
    axis.set_xlim(-0.6, len(comparisons) - 0.4)
    axis.set_xticks(places, [item.record.replace("_", " ") for item in comparisons])
    if max(len(item.record) for item in comparisons) * len(comparisons) > 30:
        axis.tick_params(axis="x", labelrotation=30)
    axis.set_ylabel("Left of the output's variance (%)")
    axis.grid(visible=False, axis="x")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    axis.set_ylim(0, 1.45 * high.max())


@house_style
def ladder_figure(path: Sequence[Candidate], experiment: Experiment) -> Figure:
    """Draw the errors on training and unseen records for the base and after each added effect, and the noise floor.

    `path` has the base, then the base and the first effect, …; `experiment` the errors' unit and the noise floor.
    """
    figure, axes = new_figure(SINGLE_COLUMN, 2.6)
    train, test = [item.train_rms for item in path], [item.test_rms for item in path]
    floor = None if experiment.floor is None else experiment.floor.rms
    errors = {"training record": train, experiment.test_data: test}
    draw_error_bars(axes, errors, distinguishing_digits(train, 3) + distinguishing_digits(test, 3), floor)
    axes.set_ylim(0, 1.15 * max(*train, *test, floor or 0.0))
    labels = [path[0].fit.structure.base.name]
    for before, item in pairwise(path):
        added = item.effects[len(before.effects) :]
        labels.append("+ " + " and ".join(added).replace("_", "\n"))
    axes.set_xticks(range(len(path)), labels)
    axes.set_ylabel(f"RMS of the simulation error ({unit_in_print(experiment.output_unit)})")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def draw_error_bars(axes, errors: dict[str, list[float]], texts: list[str], floor: float | None) -> None:
    """Draw training and unseen errors side by side, with texts above them, and the noise floor.

    The `errors` are training errors, then unseen errors, by label; `texts` has one per bar on the `axes`, those of the
    training errors first; `floor` is the RMS of the noise if it is known.
    """
    on_white = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.3}
    looks = ({"alpha": 0.45}, {"hatch": "//", "edgecolor": "white"})
    remaining = iter(texts)
    for shift, (label, values), look in zip((-0.19, 0.19), errors.items(), looks, strict=True):
        places = [place + shift for place in range(len(values))]
        axes.bar(places, values, 0.36, color=MODELS["KB"]["color"], label=label, **look)
        for place, value in zip(places, values, strict=True):
            note(axes, next(remaining), (place, value), (0, 1), ha="center", size=6, bbox=on_white)
    if floor is not None:
        mark_noise_floor(axes, floor, 0.9)
    axes.grid(visible=False, axis="x")


_DURATION_S = 8.0
"""Duration of the force over time in s."""
_BASE_STYLE = {"color": "#999999", "linestyle": (0, (4, 1.5)), "linewidth": 1.0}
_COMPACT_LEGEND = {"ncols": 2, "handlelength": 1.4, "columnspacing": 0.8, "borderpad": 0.1, "fontsize": 6.5}


@house_style
def signature_figure(effects: list[Effect], system: str = "tissue") -> Figure:
    """Draw one row per effect: force over position, added force over position at two rates, added force over time.

    Each of the `effects` is drawn in the form of `lumbar.tissue.effects.signature.pictured_form`; `effects` may be empty;
    `system` is ``tissue`` or ``pendulum``.
    """
    if not effects:
        figure, axes = new_figure(SINGLE_COLUMN, 0.6)
        axes.set_axis_off()
        show_placeholder(axes, "no effect that has a picture")
        return figure
    height = 0.25 + 1.75 * len(effects)
    figure, axes = new_figure(DOUBLE_COLUMN, height, nrows=len(effects), ncols=3, squeeze=False)
    for number, (row, effect) in enumerate(zip(axes, effects, strict=True)):
        _draw_effect(row, effect, system)
        letter = f"({ascii_lowercase[number % 26]}) " if len(effects) > 1 else ""
        row[0].set_title(letter + effect.name.replace("_", " ").capitalize(), loc="left", fontweight="bold")
    return figure


def _draw_effect(row, effect: Effect, system: str) -> None:
    form = pictured_form(effect)
    slow, fast = signatures(effect, form, system)
    moved, response = AXES[system]
    whole, added, over_time = row
    settled, cycle = slow.motion.time >= 2 / RATES[0], slow.last_cycle
    whole.plot(slow.motion.position[cycle], slow.base[cycle], label=system, **_BASE_STYLE)
    whole.plot(slow.motion.position[settled], slow.force[settled], color=SERIES[0], label="with the effect")
    whole.set_ylabel(response.capitalize())
    for item, color, line in ((slow, SERIES[0], "-"), (fast, SERIES[3], (0, (3, 1)))):
        cycle = item.last_cycle
        look = {"color": color, "linestyle": line, "linewidth": 1.0, "label": f"{item.rate:g} Hz"}
        added.plot(item.motion.position[cycle], item.added_force[cycle], **look)
    added.set_ylabel(f"Added {response}")
    added.set_title(f"${form.latex}$", loc="left")
    for axis in (whole, added):
        axis.set_xlabel(moved)
    # The added force over time, with the motion scaled to it.
    shown = slow.motion.time <= _DURATION_S
    time, force = slow.motion.time[shown], slow.added_force[shown]
    scale = np.abs(force).max() / np.abs(slow.motion.position).max()
    over_time.plot(time, scale * slow.motion.position[shown], label=f"{moved.lower()}, scaled", **_BASE_STYLE)
    over_time.plot(time, force, color=SERIES[0], linewidth=1.0, label=f"added {response}")
    over_time.set_xlabel("Time (s)")
    for axis in row:
        add_head_room(axis, 0.22)
        axis.legend(loc="upper left", **_COMPACT_LEGEND)
        axis.tick_params(labelsize=6.5)
