"""Files of figures: what matplotlib writes, but a PDF holds of its fonts the TrueType outlines alone, as journals ask."""

from __future__ import annotations

import io
import re
import zlib

import matplotlib
import matplotlib.pyplot as plt
import pytest
from fontTools.ttLib import TTFont

from lumbar.publishing.figures.style import house_style, new_figure, save


def fonts(content: bytes) -> list[TTFont]:
    """Return the TrueType fonts embedded in a PDF file."""
    streams = re.findall(rb"/FlateDecode.*?stream\r?\n(.*?)\r?\nendstream", content, flags=re.S)
    unpacked = (zlib.decompressobj().decompress(stream) for stream in streams)
    return [TTFont(io.BytesIO(stream)) for stream in unpacked if stream.startswith(b"\0\1\0\0")]


def operators(content: bytes) -> list[bytes]:
    """Operators of a PDF file's page, without the numbers before them."""
    page = re.search(rb"/FlateDecode.*?stream\r?\n(.*?)\r?\nendstream", content, flags=re.S)[1]
    return re.findall(rb"[A-Za-z*]+$", zlib.decompress(page), flags=re.M)


@pytest.fixture
def figure():
    drawn, axes = new_figure()
    axes.plot([0, 1])
    axes.set_title("office, (a)", fontweight="bold")
    axes.set_xlabel(r"Stiffness $k_\mathrm{e}$ in N·mm$^{-1}$")
    yield drawn
    plt.close(drawn)


@house_style
def test_one_drawing_for_both_formats_is_what_matplotlib_draws_for_each(figure, tmp_path):
    axes = figure.axes[0]
    axes.pcolormesh([1, 10, 100], [0, 0.5, 1], [[1, 2], [3, 4]], rasterized=True)
    axes.set_xscale("log")
    save(figure, tmp_path / "saved", "")
    figure.savefig(tmp_path / "alone.svg", metadata={"Date": None, "Description": "Drawing without data"})
    figure.savefig(tmp_path / "alone.pdf")
    assert (tmp_path / "saved.svg").read_bytes() == (tmp_path / "alone.svg").read_bytes()
    page, alone = (operators((tmp_path / f"{name}.pdf").read_bytes()) for name in ("saved", "alone"))
    assert page == alone


def test_pdf_fonts_are_the_outlines_that_matplotlib_embeds(figure, tmp_path):
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        figure.savefig(tmp_path / "whole.pdf")
    save(figure, tmp_path / "saved", "")
    content = (tmp_path / "saved.pdf").read_bytes()
    assert b"/Type3" not in content
    ours, whole = fonts(content), fonts((tmp_path / "whole.pdf").read_bytes())
    assert len(ours) == len(whole) >= 3  # upright, bold, oblique
    for font, reference in zip(ours, whole, strict=True):
        assert not {"GDEF", "GPOS", "GSUB"} & set(font.keys())
        for glyph in font.getGlyphOrder():
            assert font["glyf"][glyph] == reference["glyf"][glyph]
            assert font["hmtx"][glyph] == reference["hmtx"][glyph]
