"""A figure as SVG and PDF, drawn once for both: to find out what there is to draw takes longer than to write it."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_pdf import PdfFile, RendererPdf
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.figure import Figure

_POINTS = 72
"""To the inch, in both formats."""

_DRAWN = (
    "open_group",
    "close_group",
    "draw_path",
    "draw_markers",
    "draw_path_collection",
    "draw_gouraud_triangles",
    "draw_image",
    "finalize",
)
_ASKED = (
    "get_canvas_width_height",
    "get_text_width_height_descent",
    "get_image_magnification",
    "option_image_nocomposite",
    "option_scale_image",
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
    """Write what matplotlib's ``print_svg`` and ``print_pdf`` write.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        With its layout settled.
    svg, pdf : pathlib.Path
        Files to write.
    metadata : tuple of dict
        Of the SVG and of the PDF file, as matplotlib takes them.
    """
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
