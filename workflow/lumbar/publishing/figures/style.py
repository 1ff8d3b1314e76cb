"""Common style of all figures: sizes, fonts, colours, and saving as SVG and PDF."""

import io
import itertools
import os
from pathlib import Path
from string import ascii_lowercase

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager, get_font
from matplotlib.text import Text

from lumbar.base.files import replacing

SINGLE_COLUMN = 3.5
"""Width of a journal's column in inches."""
DOUBLE_COLUMN = 7.2
"""Width of a journal's page in inches."""

_FONTS = sorted(Path(__file__).with_name("fonts").glob("*.ttf"))
for _font in _FONTS:
    fontManager.addfont(_font)
_LOOK = mpl.rc_params_from_file(Path(__file__).with_name("house.mplstyle"), use_default_template=False)
house_style = mpl.rc_context(_LOOK)
"""Decorator for functions that draw: inside them only, matplotlib has the settings of ``house.mplstyle``."""


def new_figure(width: float = DOUBLE_COLUMN, height: float = 3.0, **subplots):
    """Return ``figure, axes`` like `matplotlib.pyplot.subplots`, but without a window that must be closed.

    Width and height are in inches; `subplots` is passed on to `matplotlib.figure.Figure.subplots`.
    """
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(**subplots)


def label_panels(axes) -> None:
    """Write (a), (b), … at the upper left of each axes, in order."""
    for letter, axis in zip(ascii_lowercase, axes, strict=False):
        axis.set_title(f"({letter})", loc="left", fontweight="bold")


def _label_unlabelled_panels(figure) -> None:
    """Write (a), (b), … before the titles of panels if the figure has no labels yet."""
    panels = [axes for axes in figure.axes if axes.axison and not hasattr(axes, "_colorbar")]
    if len(panels) < 2 or any(axes.get_title(loc="left") for axes in panels):
        return
    for letter, axes in zip(ascii_lowercase, panels, strict=False):
        if title := axes.get_title():
            axes.set_title(f"$\\mathbf{{({letter})}}$ {title}")
        else:
            axes.set_title(f"({letter})", loc="left", fontweight="bold")


def _use_math_font_fallback(figure) -> None:
    """Mark letters that the font lacks as formulas in texts with a formula: matplotlib has no other fallback for such texts."""
    known = set.intersection(*(set(get_font(path).get_charmap()) for path in _FONTS))
    for text in figure.findobj(Text):
        parts = text.get_text().split("$")
        if len(parts) < 3 or len(parts) % 2 == 0:
            continue
        for place in range(0, len(parts), 2):
            runs = itertools.groupby(parts[place], lambda letter: ord(letter) in known or letter == "\n")
            parts[place] = "".join(
                run if found else f"${run}$" for found, letters in runs if (run := "".join(letters))
            )
        text.set_text("$".join(parts))


def add_head_room(axes, share: float) -> None:
    """Extend the axes upwards by a share of their height, for a legend."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + share * (top - bottom))


def note(axes, text: str, at: tuple, offset: tuple[float, float], **look) -> None:
    """Write a text near a position in the axes, `offset` points from it."""
    axes.annotate(text, at, xytext=offset, textcoords="offset points", **look)


def show_placeholder(axes, text: str, **look) -> None:
    """Write a text, the reason why nothing is drawn, in the middle of empty axes."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", **look)


def mark_noise_floor(axes, rms: float, linewidth: float = 0.8) -> None:
    """Draw the noise floor of errors as a horizontal line."""
    axes.axhline(rms, color="black", linestyle="--", linewidth=linewidth, label="noise floor")


SUBJECT_PREFIX = "Shows: "
"""Text before subject and box at the foot of a figure and in its file's description."""


def person_and_box(facts: dict) -> str:
    """Return subject and box of a lift as text, from its ``subject`` and ``box_mass_kg``."""
    return f"{facts['subject']}, box of {facts['box_mass_kg']:g} kg"


def _freeze_layout(figure) -> None:
    """Compute the layout of the figure a single time and round the positions.

    The solver of the constrained layout differs in the last bit from run to run, and the names of clip paths in
    an SVG file are hashes of these bits.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")
    for axes in figure.axes:
        if axes.get_axes_locator() is None:
            axes.set_position([round(value, 9) for value in axes.get_position(original=True).bounds])


@house_style
def svg_text(figure) -> str:
    """Return a small drawing without data as the text of an SVG file, identical at every run."""
    _freeze_layout(figure)
    text = io.StringIO()
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Description": "Drawing without data"})
    return text.getvalue()


@house_style
def save(figure, stem: str | os.PathLike, source_label: str, who: str = "") -> None:
    """Write ``stem.svg`` and ``stem.pdf``, byte-identical at every run.

    `stem` is the path without ending. `source_label` is the origin of the data, e.g. ``"synthetic twin"``, written at the
    foot of the `figure` below its `supxlabel` and in the file's metadata; empty only for drawings without data. `who`
    is subject and box if the figure shows one lift, written before the label.
    """
    stem = Path(stem)
    description = f"Data: {source_label}" if source_label else "Drawing without data"
    description = f"{SUBJECT_PREFIX}{who}. {description}" if who else description
    if source_label:
        note_of_figure = figure.get_supxlabel()
        below = f"{note_of_figure}\n{description}" if note_of_figure else description
        figure.supxlabel(below, x=0.995, ha="right", fontsize=6, color="#555555")
    _label_unlabelled_panels(figure)
    _use_math_font_fallback(figure)
    _freeze_layout(figure)
    dpi = figure.dpi
    with replacing(stem.with_name(f"{stem.name}.svg")) as svg:
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Description": description})
    figure.dpi = dpi
    dates = {"CreationDate": None, "ModDate": None}
    with replacing(stem.with_name(f"{stem.name}.pdf")) as pdf:
        FigureCanvasPdf(figure).print_pdf(pdf, metadata={**dates, "Subject": description})
    figure.dpi = dpi


MEASURED = "#000000"
MODELS = {
    "IL": {"color": "#999999", "linestyle": (0, (1, 1)), "marker": "x", "hatch": ".."},
    "MW": {"color": "#E69F00", "linestyle": (0, (4, 1.5)), "marker": "s", "hatch": "//"},
    "Maxwell": {"color": "#CC79A7", "linestyle": (0, (6, 1.5, 1, 1.5)), "marker": "D", "hatch": "--"},
    "KB": {"color": "#0072B2", "linestyle": "-", "marker": "o", "hatch": ""},
    "HO": {"color": "#D55E00", "linestyle": (0, (2, 1)), "marker": "^", "hatch": "xx"},
    "LE": {"color": "#56B4E9", "linestyle": (0, (1, 2)), "marker": "+", "hatch": "||"},
    "KV": {"color": "#009E73", "linestyle": (0, (5, 1, 1, 1, 1, 1)), "marker": "v", "hatch": "\\\\"},
}
"""Colour, line style, marker and hatch of every model in all figures."""
WITH_EFFECTS = {"color": "#882255", "linestyle": (0, (3, 1, 1, 1)), "marker": "*", "hatch": "oo"}
"""Look of a base model with effects added."""


def model_look(name: str) -> dict:
    """Return colour, line style, marker and hatch of a model by its name."""
    return MODELS.get(name, WITH_EFFECTS)


def model_line(name: str) -> dict:
    """Return colour and line style of a model by its name."""
    return {key: model_look(name)[key] for key in ("color", "linestyle")}


SEGMENTS = {"thorax": "#0072B2", "abdomen": "#E69F00", "pelvis": "#009E73"}
"""Colour of the three trunk segments."""
SERIES = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
"""Colours for all other series, in the order of use."""
