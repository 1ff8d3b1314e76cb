"""A page with Bokeh's pictures as one file that needs nothing else, with the same bytes at every run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.templates import template

if TYPE_CHECKING:
    from bokeh.document import Document

_UNIQUE = re.compile(r"\b[0-9a-f]{8}-(?:[0-9a-f]{4}-){3}[0-9a-f]{12}\b")
_NUMBERED = re.compile(r"\bp\d{4,}\b")


def beside(*names: str, folder: Path = Path(__file__).parent) -> str:
    """Text of style sheets or scripts that lie in a folder, one after the other; default this one."""
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)


def one_file(fill: Callable[[Document], None], page: str, variables: dict[str, Any]) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    fill : callable
        Puts pictures and data into a Bokeh document.
    page : str
        Template, below the library; it extends ``reports/explorer/shell.html.jinja``.
    variables : dict
        What the template shows; with ``title``.
    """
    from bokeh.document import Document
    from bokeh.embed import file_html
    from bokeh.resources import INLINE

    document = Document()
    fill(document)
    text = file_html(
        document, INLINE, title=variables["title"], template=template(page), template_variables=variables
    )
    return _named_alike(text)


def _named_alike(text: str) -> str:
    """Bokeh names its parts by chance and by how many there were before: number them as they come."""
    for pattern, prefix in ((_UNIQUE, "part-"), (_NUMBERED, "model-")):
        numbers = itertools.count(1)
        names: dict[str, str] = {}
        text = pattern.sub(lambda found: names.setdefault(found[0], f"{prefix}{next(numbers)}"), text)  # noqa: B023
    return text
