"""Figures of thesis and article structure (1.1, 3.1), of the models (2.4, 3.2) and of their fits (3.4, 3.5)."""

import re
import textwrap
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from lumbar.base.errors import InputError
from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    MODELS,
    house_style,
    label_panels,
    model_line,
    new_figure,
    svg_text,
)
from lumbar.records.record import Record
from lumbar.tissue.models.tissue_models import IL, KB, Dashpot, Network, Parallel, Series, Spring, TissueModel
from lumbar.tissue.signals.multisine import one_period, schroeder_phases

INK = "#000000"
_LINE = 1.2
_CENTRED = {"ha": "center", "va": "center", "fontsize": 9}
_GAP = 0.18  # rigid bar above and below parts in parallel


def network_size(network: Network) -> tuple[float, float]:
    """Return width and height of a network's drawing; one element is 1 × 1."""
    match network:
        case Series(parts):
            sizes = [network_size(part) for part in parts]
            return max(width for width, _ in sizes), sum(height for _, height in sizes)
        case Parallel(parts):
            sizes = [network_size(part) for part in parts]
            return sum(width for width, _ in sizes), max(height for _, height in sizes) + 2 * _GAP
    return 1.0, 1.0


def draw_network(axis, network: Network, x: float, top: float) -> None:
    """Draw a network of `network_size` hanging from the point (x, top)."""
    ink = {"color": INK, "linewidth": _LINE}
    match network:
        case Spring(symbol):
            turns = 9
            heights = np.concatenate([[0.0], np.linspace(0.2, 0.8, turns), [1.0]])
            offsets = np.zeros(turns + 2)
            offsets[2:-2] = 0.16 * (-1.0) ** np.arange(turns - 2)
            axis.plot(x + offsets, top - heights, solid_joinstyle="round", **ink)
            _label(axis, x + 0.24, top - 0.5, symbol)
        case Dashpot(symbol):
            axis.plot([x, x], [top, top - 0.45], **ink)  # rod
            axis.plot([x - 0.13, x + 0.13], [top - 0.45] * 2, color=INK, linewidth=1.8 * _LINE)  # piston
            cup_x = [x - 0.19, x - 0.19, x + 0.19, x + 0.19]
            axis.plot(cup_x, [top - 0.3, top - 0.68, top - 0.68, top - 0.3], **ink)
            axis.plot([x, x], [top - 0.68, top - 1.0], **ink)
            _label(axis, x + 0.26, top - 0.5, symbol)
        case Series(parts):
            for part in parts:
                draw_network(axis, part, x, top)
                top -= network_size(part)[1]
        case Parallel(parts):
            width, height = network_size(network)
            left = x - width / 2
            centres = []
            for part in parts:
                part_width, part_height = network_size(part)
                centres.append(left + part_width / 2)
                left += part_width
                draw_network(axis, part, centres[-1], top - _GAP)
                bottom = top - _GAP - part_height
                axis.plot([centres[-1]] * 2, [bottom, top - height + _GAP], **ink)
            for level, inner in ((top, top - _GAP), (top - height, top - height + _GAP)):
                axis.plot([x, x], [level, inner], **ink)
                axis.plot([centres[0], centres[-1]], [inner, inner], solid_capstyle="projecting", **ink)


def _label(axis, x: float, y: float, symbol: str) -> None:
    letter, index = symbol[0], symbol[1:]
    axis.text(x, y, f"${letter}_{index}$" if index else f"${letter}$", va="center", fontsize=10)


def arrow(axis, tail: tuple[float, float], head: tuple[float, float], color: str = INK) -> None:
    """Draw an arrow between two places of the axes."""
    style = {"arrowstyle": "-|>", "color": color, "linewidth": _LINE, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", xy=head, xytext=tail, arrowprops=style)


@house_style
def analogues_figure(models: tuple[TissueModel, ...]) -> Figure:
    """Draw Figure 3.2: every model's mechanical analogue, a network between the tool (top) and the ground."""
    figure, axes = new_figure(DOUBLE_COLUMN, 2.7, ncols=len(models), squeeze=False)
    tallest = max(network_size(model.network)[1] for model in models if model.network)
    for axis, model in zip(axes[0], models, strict=True):
        axis.set(xlim=(-1.5, 1.5), ylim=(-tallest - 0.15, 0.95), aspect="equal")
        axis.axis("off")
        axis.set_title(f"{model.name}\n{model.title}", color=MODELS[model.name]["color"], fontweight="bold")
        _draw_model(axis, model, tallest)
    return figure


@house_style
def analogue_picture(model: TissueModel) -> str:
    """Return the drawing of a model's mechanical analogue for Table 2.1 as the text of an SVG file."""
    width, height = network_size(model.network)
    figure, axis = new_figure(0.45 * width + 0.2, 0.45 * height + 0.2)
    axis.set(xlim=(-width / 2 - 0.1, width / 2 + 0.25), ylim=(-height - 0.2, 0.2), aspect="equal")
    axis.axis("off")
    draw_network(axis, model.network, 0.0, 0.0)
    for end in (0.0, -height):
        axis.plot(0, end, color=INK, marker="o", markersize=3)
    return svg_text(figure)


def _draw_model(axis, model: TissueModel, tallest: float) -> None:
    if model.network is None:
        box = {"boxstyle": "square,pad=0.9", "facecolor": INK, "edgecolor": INK}
        axis.text(0, -tallest / 2, "$H(z)$\nblack box", color="white", bbox=box, **_CENTRED)
        axis.plot([0, 0], [0, -tallest], color=INK, linewidth=_LINE, zorder=0)
    else:
        rod = (tallest - network_size(model.network)[1]) / 2
        draw_network(axis, model.network, 0.0, -rod)
        for start in (0.0, rod - tallest):
            axis.plot([0, 0], [start, start - rod], color=INK, linewidth=_LINE)
    # The ground.
    axis.plot([-0.5, 0.5], [-tallest, -tallest], color=INK, linewidth=_LINE)
    for start in np.linspace(-0.5, 0.4, 7):
        axis.plot([start + 0.1, start], [-tallest, -tallest - 0.12], color=INK, linewidth=0.6 * _LINE)
    axis.plot([-0.45, 0.45], [0, 0], color=INK, linewidth=2 * _LINE)  # the tool tip
    arrow(axis, (-0.3, 0.85), (-0.3, 0.08))
    axis.text(-0.38, 0.55, "$x$", ha="right", va="center", fontsize=10)
    # The tissue pushes back against the tool; the inverted model pulls it in.
    tail, head = ((0.3, 0.85), (0.3, 0.08)) if model is IL else ((0.3, 0.08), (0.3, 0.85))
    arrow(axis, tail, head, "#D55E00")
    axis.text(0.4, 0.55, "$-F$" if model is IL else "$F$", va="center", fontsize=10, color="#D55E00")


@house_style
def arx_figure() -> Figure:
    """Draw Figure 2.4: the ARX model as a signal flow and as equations A x = b."""
    figure, axis = new_figure(DOUBLE_COLUMN, 2.2)
    axis.set(xlim=(0, 11), ylim=(-1.9, 1.5), aspect="equal")
    axis.axis("off")
    for x, text, height in ((3.2, r"$B(z^{-1})$", 0.8), (7.4, r"$\dfrac{1}{A(z^{-1})}$", 1.1)):
        axis.add_patch(Rectangle((x - 0.75, -height / 2), 1.5, height, fill=False, linewidth=_LINE))
        axis.text(x, 0.0, text, ha="center", va="center", fontsize=10)
    axis.add_patch(Circle((5.3, 0.0), 0.22, fill=False, linewidth=_LINE))
    axis.text(5.3, 0.0, "+", ha="center", va="center", fontsize=11)
    for tail, head in ((1.0, 2.45), (3.95, 5.08), (5.52, 6.65), (8.15, 9.7)):
        arrow(axis, (tail, 0.0), (head, 0.0))
    arrow(axis, (5.3, 1.05), (5.3, 0.22))
    axis.text(0.9, 0.0, "input\n$u_k$", ha="right", va="center", fontsize=9)
    axis.text(9.8, 0.0, "output\n$y_k$", ha="left", va="center", fontsize=9)
    axis.text(5.3, 1.12, "error $e_k$", ha="center", va="bottom", fontsize=9)
    rows = r"$y_k = -a_{1}\,y_{k-1} - \cdots - a_{n}\,y_{k-n} + b_{0}\,u_k + \cdots + b_{m}\,u_{k-m} + e_k$"
    axis.text(5.3, -1.15, rows, **_CENTRED)
    system = r"$\mathbf{A}\,\mathbf{x} = \mathbf{b}$,  $\mathbf{x} = (-a_1 \ldots -a_n,\; b_0 \ldots b_m)$"
    axis.text(5.3, -1.7, f"one row per sample:  {system}", **_CENTRED)
    return figure


def _segment(record: Record, segment_s: tuple[float, float]) -> np.ndarray:
    since_start = record.time - record.time[0]
    inside = (since_start >= segment_s[0] - 1e-9) & (since_start <= segment_s[1] + 1e-9)
    if not inside.any():
        raise InputError(
            f"{record.name} lasts {record.duration:g} s: tissue.segment_s {list(segment_s)} contains no sample"
        )
    return inside


@house_style
def record_segments_figure(records: list[Record], segment_s: tuple[float, float]) -> Figure:
    """Draw Figure 3.4: a segment of input and output of every record, one column each.

    The `records` have the channels ``input`` and ``output``; `segment_s` is the segment in seconds since the start of each.
    """
    size = {"nrows": 2, "ncols": len(records), "squeeze": False}
    figure, axes = new_figure(DOUBLE_COLUMN, 3.4, sharex="col", sharey="row", **size)
    for column, record in zip(axes.T, records, strict=True):
        inside = _segment(record, segment_s)
        time = record.time[inside] - record.time[0]
        column[0].plot(time, record["input"][inside], color="#0072B2")
        column[1].plot(time, record["output"][inside], color=MEASURED, linewidth=0.9)
        column[1].set(xlabel="Time (s)", xlim=segment_s)
    for axis, role in zip(axes[:, 0], ("input", "output"), strict=True):
        axis.set_ylabel(records[0].channels[role].label)
    label_panels(axes[0])
    for axis, record in zip(axes[0], records, strict=True):
        axis.set_title(record.name.replace("_", " "))
    return figure


@house_style
def free_run_figure(
    record: Record, simulated: dict[str, np.ndarray], segment_s: tuple[float, float]
) -> Figure:
    """Draw Figure 3.5: measured output, the free run of every model, and its residual.

    `record` has the channels ``input`` and ``output``; `simulated` is the free run by name of the model, shape (samples,);
    `segment_s` is the segment in seconds since the start of the record.
    """
    inside = _segment(record, segment_s)
    time, output = record.time[inside] - record.time[0], record.channels["output"]
    ratios = {"nrows": 2, "height_ratios": (2.2, 1.0)}
    figure, (response, residual) = new_figure(DOUBLE_COLUMN, 4.2, sharex=True, **ratios)
    measured = output.values[inside]
    response.plot(time, measured, color=MEASURED, linewidth=0.8, label="measured")
    for name, values in simulated.items():
        look = model_line(name)
        response.plot(time, values[inside], label=name, linewidth=1.5, **look)
        residual.plot(time, measured - values[inside], linewidth=1.0, **look)
    response.set_ylabel(output.label)
    residual.set(ylabel=f"Measured − model\n({output.unit})", xlabel="Time (s)", xlim=segment_s)
    response.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(simulated) + 1)
    return figure


_TEXT_HEIGHT, _BOX_WIDTH = 0.4, 4.5
"""Height of a line of text and width of a box, in units of the axes."""


@dataclass(frozen=True)
class _Box:
    """A box of Figure 1.1."""

    x: float
    y: float
    title: str
    items: tuple[str, ...] = ()

    def lines(self) -> list[tuple[str, dict]]:
        """Return the lines of the box with their styles: title, items, and in grey the corresponding chapters of a study."""
        lines = [(self.title, {"fontweight": "bold"}), *((item, {}) for item in self.items)]
        number = re.search(r"Chapter ([3-6])", " ".join((self.title, *self.items)))
        if number is None:
            return lines
        from lumbar.publishing.study_report.contents import CHAPTERS

        place = "all chapters" if number[1] in "56" else f"Chapters?( 2 and)? {number[1]}"
        made = [title.lower() for title, section in CHAPTERS.values() if re.match(place, section)]
        grey = {"color": "#555555", "fontsize": 6.5}
        return lines + [(line, grey) for line in textwrap.wrap(f"here: {', '.join(made)}", 52)]

    @property
    def half_height(self) -> float:
        """Half of the height of the box."""
        return 0.5 * _TEXT_HEIGHT * (len(self.lines()) + 0.6)


_BOXES = {
    "motivation": _Box(5.0, 8.6, "Motivation: low back pain"),
    "review": _Box(5.0, 7.45, "Chapter 2: literature review"),
    "simulation": _Box(
        2.5, 5.75, "Surgical simulation", ("modelling surgical movements", "modelling tissue force feedback")
    ),
    "stability": _Box(7.5, 5.75, "Spine stability", ("Lyapunov exponents", "basins of attraction")),
    "manuscript": _Box(2.5, 3.6, "Surgical intervention", ("Chapter 3: manuscript",)),
    "study": _Box(7.5, 3.6, "Preventative measures", ("Chapter 4: additional study",)),
    "end": _Box(5.0, 1.2, "Chapter 5: discussion. Chapter 6: conclusion"),
}
_ARROWS = (
    *(("motivation", "review"), ("review", "simulation"), ("review", "stability")),
    *(("simulation", "manuscript"), ("stability", "study"), ("manuscript", "end"), ("study", "end")),
)


@house_style
def outline_figure() -> Figure:
    """Draw Figure 1.1: chapters and objectives of the thesis, from the motivation to the conclusion."""
    figure, axis = new_figure(DOUBLE_COLUMN, 4.3)
    axis.set(xlim=(0, 10), ylim=(0.5, 9.1))
    axis.axis("off")
    for box in _BOXES.values():
        look = {"boxstyle": "round,pad=0,rounding_size=0.15", "facecolor": "white", "edgecolor": INK}
        half = box.half_height
        axis.add_patch(FancyBboxPatch((box.x - _BOX_WIDTH / 2, box.y - half), _BOX_WIDTH, 2 * half, **look))
        for number, (line, style) in enumerate(box.lines()):
            _write(axis, box.x, box.y + half - _TEXT_HEIGHT * (number + 0.8), line, **style)
    for source, target in _ARROWS:
        start, end = _BOXES[source], _BOXES[target]
        arrow(axis, (start.x, start.y - start.half_height), (end.x, end.y + end.half_height))
    return figure


@house_style
def article_figure() -> Figure:
    """Draw Figure 3.1: the steps from signals and systems to the simulation, with a sketch of each."""
    steps = (
        ("Signals", "excite the tissue across\nthe surgeons' bandwidth"),
        ("Systems", "identify the tissue as\ndynamic viscoelastic models"),
        ("Simulation", "test the models\nin a surgical simulator"),
    )
    figure, axes = new_figure(DOUBLE_COLUMN, 2.3, ncols=len(steps))
    frame = {"boxstyle": "round,pad=0,rounding_size=0.1", "facecolor": "none", "edgecolor": INK}
    for axis, (title, text) in zip(axes, steps, strict=True):
        axis.set(xlim=(0, 3), ylim=(0, 2.4), aspect="equal")
        axis.axis("off")
        axis.add_patch(FancyBboxPatch((0.05, 0.05), 2.75, 2.3, **frame))
        _write(axis, 1.42, 2.12, title, fontsize=9, fontweight="bold")
        _write(axis, 1.42, 1.72, text, fontsize=7)
        if axis is not axes[0]:
            arrow(axis, (-0.38, 1.2), (0.05, 1.2))
    signal, system, simulation = axes
    # A period of a multisine of Eq. 3.1 with few lines and Schroeder's phases.
    lines, amplitudes = np.arange(1, 7), np.ones(6)
    period = one_period(lines, amplitudes, schroeder_phases(amplitudes), 256)
    signal.plot(np.linspace(0.3, 2.55, 256), 0.78 + 0.45 * period / np.abs(period).max(), color=INK)
    arrow(signal, (0.3, 0.2), (2.6, 0.2))
    _write(signal, 2.6, 0.32, "t")
    _write(signal, 0.22, 1.28, "x")
    # The Kelvin–Boltzmann model between position and force.
    inner = system.inset_axes([0.3, 0.04, 0.34, 0.58])
    width, height = network_size(KB.network)
    inner.set(xlim=(-width / 2 - 0.1, width / 2 + 0.3), ylim=(-height, 0.0), aspect="equal")
    inner.axis("off")
    draw_network(inner, KB.network, 0.0, 0.0)
    for text, place, start in (("x(t)", 0.35, 0.6), ("f(t)", 2.5, 1.9)):
        _write(system, place, 0.75, text)
        arrow(system, (start, 0.75), (start + 0.35, 0.75))
    # The loop of model, haptic device and hand.
    box = {"boxstyle": "square,pad=0.5", "facecolor": "white", "edgecolor": INK}
    for x, text in ((0.75, "model"), (2.05, "haptic\ndevice,\nhand")):
        _write(simulation, x, 0.75, text, bbox=box)
    arrow(simulation, (1.1, 0.9), (1.68, 0.9), "#D55E00")
    _write(simulation, 1.39, 1.05, "force", color="#D55E00")
    arrow(simulation, (1.68, 0.6), (1.1, 0.6), INK)
    _write(simulation, 1.39, 0.45, "position", color=INK)
    return figure


def _write(axis, x: float, y: float, text: str, **look) -> None:
    axis.text(x, y, text, **({"ha": "center", "va": "center", "fontsize": 7.5} | look))
