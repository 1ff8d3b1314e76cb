"""Simulations with their measurements, shares of the records that they explain, error ladders, effects' signatures."""

from collections.abc import Callable
from string import ascii_lowercase

import numpy as np
from matplotlib.figure import Figure

from lumbar.publishing.figures.palette import MEASURED, MODELS, SERIES
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    SINGLE_COLUMN,
    head_room,
    house_style,
    label_panels,
    mark_noise_floor,
    new_figure,
    note,
    say_instead,
)
from lumbar.records.record import Record
from lumbar.tables.layout import unit_in_print
from lumbar.tissue.diagnosis.residuals.compare import Comparison
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits
from lumbar.tissue.effects.signature import AXES, RATES, pictured_form, signatures
from lumbar.tissue.models.form import Effect

_SHOWN_SAMPLES = 500
"""Samples of the default segment."""
_NOISE = {"color": "#bbbbbb", "edgecolor": "#555555", "linewidth": 0.6}
_EXPLAINABLE = {"color": "white", "edgecolor": MODELS["HO"]["color"], "hatch": "////", "linewidth": 0.8}


def default_segment(record: Record, simulated: np.ndarray, start: float) -> tuple[float, float]:
    """Return start and end in s of a segment with an error as large as on the whole record."""
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
) -> Figure:
    """Draw a typical segment of one record with its residual, and what the model leaves of every record's variance.

    Parameters
    ----------
    record : Record
        Channels ``input`` and ``output``; one of the compared records.
    simulated : numpy.ndarray, shape (samples,)
        Free run over the record.
    comparisons : list of Comparison
        Of all records, this one among them.
    model : str
        Name of the model in the legend.
    """
    mine = next(item for item in comparisons if item.record == record.name)
    segment = default_segment(record, simulated, mine.start)
    figure, axes = new_figure(
        DOUBLE_COLUMN, 3.4, nrows=2, ncols=2, width_ratios=(1.9, 1), height_ratios=(1.7, 1), sharex="col"
    )
    response, residual = axes[:, 0]
    grid = axes[0, 1].get_gridspec()
    for axis in axes[:, 1]:
        axis.remove()
    shares = figure.add_subplot(grid[:, 1])
    draw_segment((response, residual), record, simulated, mine, segment, model)
    output = record.channels["output"]
    response.set(
        ylabel=f"{output.quantity.capitalize()} ({unit_in_print(output.unit)})",
        title=record.name.replace("_", " "),
    )
    response.legend(loc="upper right", ncols=2)
    head_room(response, 0.18)
    residual.set_xlim(segment)
    _draw_shares(shares, comparisons)
    label_panels([response, shares, residual])
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
    color = MODELS.get(model.split("+")[0].split()[-1], MODELS["KB"])["color"]
    response.plot(time, measured, color=MEASURED, linewidth=0.9, label="measured")
    dashed = {"linestyle": (0, (4, 1.2)), "linewidth": 1.4}
    response.plot(time, modelled, color=color, label=f"{model}, free run", **dashed)
    if comparison.floor is not None:
        band = 2 * comparison.floor.rms
        residual.axhspan(-band, band, color="#cccccc", linewidth=0, label="± 2 × noise floor")
    residual.plot(time, measured - modelled, color=color, linewidth=0.8)
    residual.set(ylabel=f"Measured − model\n({unit_in_print(comparison.unit)})", xlabel="Time (s)")
    if comparison.floor is not None:
        head_room(residual, 0.25)
        residual.legend(loc="upper right")


def _draw_shares(axis, comparisons: list[Comparison]) -> None:
    """Draw the shares of the output's variance that remain: explainable and noise."""
    left = np.array([100 * item.rms.value**2 / item.output_variance for item in comparisons])
    below = [100 * (item.rms.value**2 - item.rms.low**2) / item.output_variance for item in comparisons]
    above = [100 * (item.rms.high**2 - item.rms.value**2) / item.output_variance for item in comparisons]
    reach = np.array([below, above])
    places = np.arange(len(comparisons))
    if comparisons[0].floor is not None:
        explainable = np.array([item.explainable_percent for item in comparisons])
        axis.bar(places, left - explainable, 0.55, label="noise", **_NOISE)
        axis.bar(places, explainable, 0.55, bottom=left - explainable, label="explainable", **_EXPLAINABLE)
    else:
        axis.bar(places, left, 0.55, label="noise and error of the model", **_NOISE)
    axis.errorbar(places, left, np.maximum(reach, 0), fmt="none", color="black", capsize=2, linewidth=0.8)
    highest = float((left + reach[1]).max())
    for place, item, total, upper in zip(places, comparisons, left, reach[1], strict=True):
        words = f"VAF\n{item.vaf.value:.4g} %"
        note(axis, words, (place, total + upper), (0, 3), ha="center", fontsize=6.5)
    axis.set_xlim(-0.6, len(comparisons) - 0.4)
    axis.set_xticks(places, [item.record.replace("_", " ") for item in comparisons])
    if max(len(item.record) for item in comparisons) * len(comparisons) > 30:
        axis.tick_params(axis="x", labelrotation=30)
    axis.set_ylabel("Left of the output's variance (%)")
    axis.grid(visible=False, axis="x")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    axis.set_ylim(0, 1.45 * highest)


@house_style
def ladder_figure(rungs: list[dict], unit: str, floor: float | None) -> Figure:
    """Draw training and unseen error of every rung, and the noise floor.

    Parameters
    ----------
    rungs : list of dict
        ``label``, ``train_rms`` and ``test_rms`` of base, base and first effect, ….
    unit : str
        Unit of the errors.
    floor : float or None
        Noise floor if known.
    """
    figure, axes = new_figure(SINGLE_COLUMN, 2.6)
    train, test = ([rung[key] for rung in rungs] for key in ("train_rms", "test_rms"))
    errors = {"training record": train, "unseen records": test}
    draw_error_bars(axes, errors, lambda values: distinguishing_digits(values, 2), floor)
    lines = [floor] if floor else []
    smallest, largest = min([*train, *test, *lines]), max([*train, *test, *lines])
    if largest > 8 * smallest:
        axes.set(yscale="log", ylim=(0.5 * smallest, 2.2 * largest))
    else:
        axes.set_ylim(0, 1.25 * largest)
    axes.set_xticks(range(len(rungs)), [rung["label"] for rung in rungs])
    axes.set_ylabel(f"RMS of the simulation error ({unit_in_print(unit)})")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def draw_error_bars(
    axes, errors: dict[str, list[float]], in_words: Callable[[list[float]], list[str]], floor: float | None
) -> None:
    """Draw training and unseen errors side by side, by label, with their values above and the noise floor."""
    on_white = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.3}
    looks = ({"alpha": 0.45}, {"hatch": "//", "edgecolor": "white"})
    for shift, (label, values), look in zip((-0.19, 0.19), errors.items(), looks, strict=True):
        places = [place + shift for place in range(len(values))]
        axes.bar(places, values, 0.36, color=MODELS["KB"]["color"], label=label, **look)
        for place, value, words in zip(places, values, in_words(values), strict=True):
            note(axes, words, (place, value), (0, 1), ha="center", size=6, bbox=on_white)
    if floor is not None:
        mark_noise_floor(axes, floor, 0.9)
    axes.grid(visible=False, axis="x")


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
_CLOSE = {"ncols": 2, "handlelength": 1.4, "columnspacing": 0.8, "borderpad": 0.1, "fontsize": 6.5}


@house_style
def signature_figure(effects: list[Effect], system: str = "tissue") -> Figure:
    """Draw one row per effect: force over position, added force over position at two rates, added force over time.

    Parameters
    ----------
    effects : list of Effect
        Each is drawn in the form of `lumbar.tissue.effects.signature.pictured_form`; the list may be empty.
    system : str
        ``tissue`` or ``pendulum``.
    """
    if not effects:
        figure, axes = new_figure(SINGLE_COLUMN, 0.6)
        axes.set_axis_off()
        say_instead(axes, "no effect that has a picture")
        return figure
    figure, axes = new_figure(
        DOUBLE_COLUMN, 0.25 + 1.75 * len(effects), nrows=len(effects), ncols=3, squeeze=False
    )
    for number, (row, effect) in enumerate(zip(axes, effects, strict=True)):
        _draw_effect(row, effect, system)
        letter = f"({ascii_lowercase[number % 26]}) " if len(effects) > 1 else ""
        row[0].set_title(letter + effect.name.replace("_", " ").capitalize(), loc="left", fontweight="bold")
    return figure


@house_style
def _draw_effect(row, effect: Effect, system: str) -> None:
    form = pictured_form(effect)
    slow, fast = signatures(effect, form, system)
    moved, response = AXES[system]
    whole, added, course = row
    settled, cycle = slow.motion.time >= 2 / RATES[0], slow.last_cycle
    whole.plot(slow.motion.position[cycle], slow.base[cycle], label=system, **_BASE)
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
    shown = slow.motion.time <= _SHOWN_S
    time, force = slow.motion.time[shown], slow.added_force[shown]
    scale = np.abs(force).max() / np.abs(slow.motion.position).max()
    course.plot(time, scale * slow.motion.position[shown], label=f"{moved.lower()}, scaled", **_BASE)
    course.plot(time, force, color=SERIES[0], linewidth=1.0, label=f"added {response}")
    course.set_xlabel("Time (s)")
    for axis in row:
        head_room(axis, 0.22)
        axis.legend(loc="upper left", **_CLOSE)
        axis.tick_params(labelsize=6.5)
