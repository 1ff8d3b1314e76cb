"""One look for all figures: sizes, type, saving as SVG and PDF."""

import io
import itertools
import os
from pathlib import Path
from unittest import mock

import matplotlib as mpl
from fontTools import subset
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import PdfFile, RendererPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager, get_font
from matplotlib.text import Text

from lumbar.base.files import replacing

_POINTS = 72
"""To the inch, in both formats."""

_DRAWN = (
    *("open_group", "close_group", "draw_path", "draw_markers"),
    *("draw_path_collection", "draw_gouraud_triangles", "draw_image", "finalize"),
)
_ASKED = (
    *("get_canvas_width_height", "get_text_width_height_descent", "get_image_magnification"),
    *("option_image_nocomposite", "option_scale_image"),
)
"""Both answer alike: that of the SVG file is taken."""


class _Both(RendererBase):
    """Hands what is drawn to a renderer of each format."""

    def __init__(self, svg: RendererSVG, pdf: RendererPdf):
        super().__init__()
        self._svg, self._pdf = svg, pdf
        for name in _DRAWN:
            setattr(self, name, self._handed_on(name))
        for name in _ASKED:
            setattr(self, name, getattr(svg, name))
        # A PDF file's graphics context holds what an SVG file asks of it, and more.
        self.new_gc, self.flipy = pdf.new_gc, pdf.flipy

    def _handed_on(self, name: str):
        svg, pdf = getattr(self._svg, name), getattr(self._pdf, name)

        def draw(*arguments, **options) -> None:
            svg(*arguments, **options)
            pdf(*arguments, **options)

        return draw

    def draw_text(self, gc, x, y, *text, **options) -> None:
        """Draw text; its place is measured from above in an SVG file, from below in a PDF file."""
        self._svg.draw_text(gc, x, self._svg.height - y, *text, **options)
        self._pdf.draw_text(gc, x, y, *text, **options)


def print_svg_and_pdf(figure: Figure, svg: Path, pdf: Path, metadata: tuple[dict, dict]) -> None:
    """Write a figure whose layout is settled as ``print_svg`` and ``print_pdf`` do, with the metadata of SVG and PDF."""
    of_svg, of_pdf = metadata
    dpi, (width, height) = figure.dpi, figure.get_size_inches()
    figure.dpi = _POINTS
    with svg.open("w", encoding="utf-8") as text, pdf.open("wb") as file:
        document = PdfFile(file, metadata=of_pdf)
        document.newPage(width, height)
        size = (width * _POINTS, height * _POINTS)
        both = _Both(
            RendererSVG(*size, text, image_dpi=dpi, metadata=of_svg),
            RendererPdf(document, dpi, height, width),
        )
        figure.draw(MixedModeRenderer(figure, width, height, dpi, both))
        both.finalize()
        document.finalize()


SINGLE_COLUMN = 3.5
"""Width of a journal's column in inches."""
DOUBLE_COLUMN = 7.2
"""Width of a journal's page in inches."""

_FONTS = sorted(Path(__file__).with_name("fonts").glob("*.ttf"))
for _font in _FONTS:
    fontManager.addfont(_font)
_LOOK = mpl.rc_params_from_file(Path(__file__).with_name("house.mplstyle"), use_default_template=False)
house_style = mpl.rc_context(_LOOK)
"""Decorator of what draws, within which matplotlib's settings are the house's: a notebook keeps its own."""
_METADATA = {
    "svg": lambda words: {"Date": None, "Description": words},
    "pdf": lambda words: {"CreationDate": None, "ModDate": None, "Subject": words},
}


def new_figure(width: float = DOUBLE_COLUMN, height: float = 3.0, **subplots):
    """Return ``figure, axes`` as `matplotlib.pyplot.subplots` does, but known to nobody else: no window, nothing to close.

    Width and height are in inches; `subplots` is passed on to `matplotlib.figure.Figure.subplots`.
    """
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(**subplots)


def label_panels(axes) -> None:
    """Write (a), (b), … at the upper left of each axes, in order."""
    for letter, axis in zip("abcdefghijklmnopqrstuvwxyz", axes, strict=False):
        axis.set_title(f"({letter})", loc="left", fontweight="bold")


def _letter_the_rest(figure) -> None:
    """Letter the panels of a figure that were not, before their titles."""
    panels = [axes for axes in figure.axes if axes.axison and not hasattr(axes, "_colorbar")]
    if len(panels) < 2 or any(axes.get_title(loc="left") for axes in panels):
        return
    for letter, axes in zip("abcdefghijklmnopqrstuvwxyz", panels, strict=False):
        place = "center" if axes.get_title() else "left"
        title = axes.get_title(loc=place)
        look = {} if title else {"fontweight": "bold"}
        axes.set_title(f"$\\mathbf{{({letter})}}$ {title}" if title else f"({letter})", loc=place, **look)


def _in_fonts_that_have_them(figure) -> None:
    """Set what the font lacks as mathematics in texts that hold a formula: only there such texts take it from another."""
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


def head_room(axes, share: float) -> None:
    """Leave room above what is drawn, a share of its height, for a legend."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + share * (top - bottom))


def note(axes, words: str, at: tuple, offset: tuple[float, float], **look) -> None:
    """Write words beside a place of the axes, `offset` points from it."""
    axes.annotate(words, at, xytext=offset, textcoords="offset points", **look)


def say_instead(axes, words: str, **look) -> None:
    """Write into the middle of empty axes why nothing is drawn there."""
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", **look)


def mark_noise_floor(axes, rms: float, linewidth: float = 0.8) -> None:
    """Draw the noise floor of errors as a line across."""
    axes.axhline(rms, color="black", linestyle="--", linewidth=linewidth, label="noise floor")


SHOWS = "Shows: "
"""What stands before person and box at the foot of a picture and in its file's description."""


def person_and_box(facts: dict) -> str:
    """Return person and box of a lift in words, from its ``subject`` and ``box_mass_kg``."""
    return f"{facts['subject']}, box of {facts['box_mass_kg']:g} kg"


def _settle_layout(figure) -> None:
    """Lay the figure out once, with positions rounded.

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


def _load_unplaced(file, options, load=subset.load_font, **more):
    """Font without the tables that find and place glyphs: a PDF file does so itself, and no reader of it uses these tables.

    To reduce them to the glyphs shown would take half the time of a figure.
    """
    font = load(file, options, **more)
    for table in ("GDEF", "GPOS", "GSUB", "MATH", "OS/2", "cmap", "kern"):
        if table in font:
            del font[table]
    return font


@house_style
def svg_text(figure) -> str:
    """Return a small drawing without data as the text of an SVG file, the same at every run."""
    _settle_layout(figure)
    text = io.StringIO()
    FigureCanvasSVG(figure).print_svg(text, metadata=_METADATA["svg"]("Drawing without data"))
    return text.getvalue()


@house_style
def save(figure, stem: str | os.PathLike, source_label: str, who: str = "") -> None:
    """Write ``stem.svg`` and ``stem.pdf``, byte for byte the same at every run.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The finished figure.
    stem : path
        Path without ending.
    source_label : str
        Where the data come from, e.g. ``"synthetic twin"``: stands at the foot of the picture and in the file's
        metadata, below a note of the figure's own (its `supxlabel`). Empty only for drawings that show no data.
    who : str
        Person and box that the picture shows, where it shows one: stands beside `source_label`.
    """
    stem = Path(stem)
    words = f"Data: {source_label}" if source_label else "Drawing without data"
    words = f"{SHOWS}{who}. {words}" if who else words
    if source_label:
        own = figure.get_supxlabel()
        below = f"{own}\n{words}" if own else words
        figure.supxlabel(below, x=0.995, ha="right", fontsize=6, color="#555555")
    _letter_the_rest(figure)
    _in_fonts_that_have_them(figure)
    _settle_layout(figure)
    with (
        replacing(stem.with_name(f"{stem.name}.svg")) as svg,
        replacing(stem.with_name(f"{stem.name}.pdf")) as pdf,
        mock.patch.object(subset, "load_font", _load_unplaced),
    ):
        print_svg_and_pdf(figure, svg, pdf, [metadata(words) for metadata in _METADATA.values()])
