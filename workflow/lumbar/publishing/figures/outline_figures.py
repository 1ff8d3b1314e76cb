"""Figures 1.1 and 3.1: structure of the thesis with the chapters of a study that make each part, and its first article."""

import re
import textwrap
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from lumbar.publishing.figures.style import DOUBLE_COLUMN, house_style, new_figure
from lumbar.publishing.figures.tissue_figures import INK, arrow, draw_network, network_size
from lumbar.publishing.study_report.contents import CHAPTERS
from lumbar.tissue.models.tissue_models import KB
from lumbar.tissue.signals.multisine import one_period, schroeder_phases

_LINE, _WIDTH = 0.4, 4.5
"""Height of a line of text, and width of a box."""


@dataclass(frozen=True)
class _Box:
    """A box of Figure 1.1."""

    x: float
    y: float
    title: str
    items: tuple[str, ...] = ()

    def lines(self) -> list[tuple[str, dict]]:
        """Return its lines with their style: title, items, and in grey the chapters of a study that make it."""
        lines = [(self.title, {"fontweight": "bold"}), *((item, {}) for item in self.items)]
        number = re.search(r"Chapter ([3-6])", " ".join((self.title, *self.items)))
        if number is None:
            return lines
        place = "all chapters" if number[1] in "56" else f"Chapters?( 2 and)? {number[1]}"
        made = [title.lower() for title, section in CHAPTERS.values() if re.match(place, section)]
        grey = {"color": "#555555", "fontsize": 6.5}
        return lines + [(line, grey) for line in textwrap.wrap(f"here: {', '.join(made)}", 52)]

    @property
    def half_height(self) -> float:
        """Half of its height."""
        return 0.5 * _LINE * (len(self.lines()) + 0.6)


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
        axis.add_patch(FancyBboxPatch((box.x - _WIDTH / 2, box.y - half), _WIDTH, 2 * half, **look))
        for number, (line, style) in enumerate(box.lines()):
            _write(axis, box.x, box.y + half - _LINE * (number + 0.8), line, **style)
    for source, target in _ARROWS:
        start, end = _BOXES[source], _BOXES[target]
        arrow(axis, (start.x, start.y - start.half_height), (end.x, end.y + end.half_height))
    return figure


@house_style
def article_figure() -> Figure:
    """Draw Figure 3.1: from signals over systems to the simulation, with a sketch of each step."""
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
