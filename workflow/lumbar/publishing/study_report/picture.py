"""Pictures as they stand in the report: SVG files without what nobody sees, and what they say of themselves."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from html import unescape
from pathlib import Path

from lumbar.publishing.figures.style import SHOWS

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_DRAWN = re.compile(r'(?<=\s)(?:d|points|x|y|cx|cy)="[^"]*"')
_DESCRIPTION = re.compile(r"<dc:description>(.*?)</dc:description>", flags=re.S)
_SIZE = re.compile(r'<svg\b[^>]*?\bviewBox="[\d.+-]+ [\d.+-]+ ([\d.]+) ([\d.]+)"', flags=re.S)


@dataclass(frozen=True)
class Picture:
    """A picture inside the page."""

    address: str
    """``data:`` address of the SVG file."""
    width: int
    height: int
    """`width`, `height`: in points."""
    data: str
    """Where the data come from; "Drawing without data" where there are none."""
    shows: str = ""
    """Person and box, where it shows one."""


def read_picture(path: Path) -> Picture:
    """Read an SVG file of `lumbar.publishing.figures.style.save`.

    Lengths are rounded to hundredths of a point, and the text's indentation is left out: a third less to send.
    """
    text = path.read_text(encoding="utf-8")
    described = _DESCRIPTION.search(text)
    words = unescape(described[1]) if described else ""
    shows, _, data = words.rpartition("Data: ")
    size = _SIZE.search(text)
    width, height = (round(float(size[number])) for number in (1, 2)) if size else (520, 300)
    coded = base64.b64encode(smaller(text).encode()).decode("ascii")
    return Picture(
        f"data:image/svg+xml;base64,{coded}", width, height, data, shows.removeprefix(SHOWS).rstrip(". ")
    )


def smaller(svg: str) -> str:
    """Return an SVG text with lengths rounded and without indentation."""
    rounded = _DRAWN.sub(lambda found: _NUMBER.sub(lambda number: _rounded(number[0]), found[0]), svg)
    return re.sub(r"\s*\n\s*", "\n", rounded)


def _rounded(number: str) -> str:
    return f"{float(number):.2f}".rstrip("0").rstrip(".")
