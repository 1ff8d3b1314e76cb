"""Building blocks of a page, macros of ``page.html.jinja``: what they are given is escaped, blocks are not again."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.base.templates import template

if TYPE_CHECKING:
    from markupsafe import Markup

PAGE = "publishing/pages/page.html.jinja"


def _macros():
    return template(PAGE).make_module({"title": "", "data": "", "blocks": ()})


def heading(text: str, level: int = 2) -> Markup:
    """Heading of a section."""
    return _macros().heading(text, level)


def paragraph(text: str, kind: str = "") -> Markup:
    """Paragraph; `kind` is a class of the page's style: ``headline`` or ``note``."""
    return _macros().paragraph(text, kind)


def listing(lines: Iterable[str]) -> Markup:
    """Bulleted list."""
    return _macros().listing(lines)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Markup:
    """Table of texts and pictures."""
    return _macros().table(head, rows)


def picture(svg: str | Path, description: str, kind: str = "") -> Markup:
    """SVG picture inside the page, as an image: its style and names cannot meet those of another one.

    Parameters
    ----------
    svg : str or pathlib.Path
        Text, or file.
    description : str
        What it shows, for those who cannot see it.
    kind : str
        Class of the page's style: ``equation`` stands in a line of text.
    """
    return _macros().picture(_coded(svg), description, kind)


def figure(svg: str | Path, caption: str) -> Markup:
    """Picture with a caption."""
    return _macros().figure(_coded(svg), caption)


def document(title: str, data: str, blocks: Iterable[Markup]) -> str:
    """Return a whole page of blocks; `data` says where the data come from and is empty for pages without any."""
    return template(PAGE).render(title=title, data=data, blocks=blocks)


def _coded(svg: str | Path) -> str:
    content = svg.read_bytes() if isinstance(svg, Path) else svg.encode()
    return base64.b64encode(content).decode("ascii")
