"""Pages with Bokeh's pictures as self-contained files, byte-identical at every run."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.core.serialization import Serializer
from bokeh.document import Document
from bokeh.embed.bundle import bundle_for_objs_and_resources
from bokeh.embed.elements import html_page_for_render_items
from bokeh.embed.util import RenderItem, standalone_docs_json_and_render_items
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure
from bokeh.resources import INLINE

from lumbar.base.templates import template

_CODE_PLACEHOLDER = "<!-- Bokeh's code -->"
"""Placeholder for Bokeh's code while names are replaced."""
# In quotes: encoded numbers may contain ``+p1234/``, and a model's token is not a name.
_UNIQUE_NAMES = re.compile(r"""(?<=["'])[0-9a-f]{8}-(?:[0-9a-f]{4}-){3}[0-9a-f]{12}(?=["'])""")
_NUMBERED = re.compile(r"""(?<=["'])p\d{4,}(?=["'])""")


def empty_source(name: str, columns: Iterable[str]) -> ColumnDataSource:
    """Return an empty data source that the page's script fills."""
    return ColumnDataSource({column: [] for column in columns}, name=name)


def plain_figure(name: str, across: str, up: str, left: int, **more) -> figure:
    """Return a picture as wide as its container, without frame and background, with `left` pixels for axis labels."""
    more |= {"sizing_mode": "stretch_width", "x_axis_label": across, "y_axis_label": up}
    picture = figure(name=name, **more)
    picture.toolbar.logo = None
    picture.min_border_left, picture.outline_line_color = left, None
    picture.background_fill_alpha = picture.border_fill_alpha = 0.0
    return picture


@dataclass(frozen=True, eq=False)
class EmbeddedPictures:
    """Bokeh's pictures in a page."""

    documents: dict[str, Any]
    """Bokeh's document by its name."""
    items: list[RenderItem]
    """Bokeh's render items, one per picture."""
    code: str
    """Bokeh's scripts."""
    style: str
    """Bokeh's style sheets."""


def add_roots(document: Document, pictures: Iterable[figure]) -> None:
    """Add pictures to a document."""
    with document.models.freeze():  # otherwise every root would have all models searched again
        for picture in pictures:
            document.add_root(picture)


def embed_pictures(fill: Callable[[Document], None]) -> EmbeddedPictures:
    """Return the pictures that `fill` adds with their data to a Bokeh document."""
    document = Document()
    fill(document)
    documents, items = standalone_docs_json_and_render_items(document)
    return EmbeddedPictures(documents, items, *bundle_for_objs_and_resources([document], INLINE))


def one_file(
    pictures: EmbeddedPictures,
    page: str,
    variables: dict[str, Any],
    sources: Sequence[ColumnDataSource] = (),
) -> str:
    """Return a page as HTML.

    `page` is a template that extends ``publishing/explorer/shell.html.jinja``, with its `variables`; the page's script
    finds the `sources`, further data in the document of the `pictures`, by name.
    """
    documents = pictures.documents
    if sources:
        ((name, document),) = documents.items()
        first, *others = document["roots"]
        tags = Serializer(deferred=False).encode(list(sources))
        first = {**first, "attributes": {**first["attributes"], "tags": tags}}
        documents = {name: {**document, "roots": [first, *others]}}
    scripts_and_style, title = (_CODE_PLACEHOLDER, pictures.style), variables["title"]
    text = html_page_for_render_items(
        scripts_and_style, documents, pictures.items, title, template(page), variables
    )
    # Bokeh's names are random or depend on how many there were before: number them in their order.
    for pattern, prefix in ((_UNIQUE_NAMES, "part-"), (_NUMBERED, "model-")):
        names: dict[str, str] = {}

        def number(match: re.Match, names=names, prefix=prefix) -> str:
            return names.setdefault(match[0], f"{prefix}{len(names) + 1}")

        text = pattern.sub(number, text)
    return text.replace(_CODE_PLACEHOLDER, pictures.code, 1)
