"""Building blocks of a page: no script, no outside resource; pictures lie in the page itself."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path


def heading(text: str, level: int = 2) -> str:
    """Heading of a section."""
    return f"<h{level}>{html.escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """Paragraph; `kind` is a class of the page's style: ``headline`` or ``note``."""
    return f"<p{_class(kind)}>{html.escape(text)}</p>"


def listing(lines: Iterable[str]) -> str:
    """Bulleted list."""
    return "<ul>\n" + "\n".join(f"<li>{html.escape(line)}</li>" for line in lines) + "\n</ul>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table of texts. A cell that is a `Markup` goes in as it is."""
    first = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "\n".join("<tr>" + "".join(f"<td>{_cell(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{first}</tr></thead><tbody>\n{body}\n</tbody></table>"


class Markup(str):
    """HTML that is not escaped again."""

    __slots__ = ()


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
    content = svg.read_bytes() if isinstance(svg, Path) else svg.encode()
    coded = base64.b64encode(content).decode("ascii")
    return Markup(
        f'<img{_class(kind)} src="data:image/svg+xml;base64,{coded}" alt="{html.escape(description, quote=True)}">'
    )


def figure(svg: str | Path, caption: str) -> str:
    """Picture with a caption."""
    return f"<figure>{picture(svg, caption)}<figcaption>{html.escape(caption)}</figcaption></figure>"


def document(title: str, data: str, blocks: Iterable[str]) -> str:
    """Return a whole page.

    Parameters
    ----------
    title : str
    data : str
        Where the data come from; empty for pages without data.
    blocks : iterable of str
        From the functions of this module.
    """
    label = f"<p><b>Data: {html.escape(data)}</b></p>\n" if data else ""
    return _PAGE.format(title=html.escape(title), label=label, body="\n".join(blocks))


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""


def _cell(text: str) -> str:
    return text if isinstance(text, Markup) else html.escape(text)


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: "DejaVu Sans", Arial, sans-serif; margin: 2em auto; padding: 0 1em; max-width: 62em; color: #111; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; margin-bottom: 1.5em; }}
th, td {{ padding: 0.25em 0.8em; text-align: left; vertical-align: middle; }}
thead tr {{ border-top: 2px solid #111; border-bottom: 1px solid #111; }}
tbody tr:last-child {{ border-bottom: 2px solid #111; }}
figure {{ margin: 1em 0 1.8em; }}
figure img {{ max-width: 100%; }}
figcaption, .note {{ color: #444; font-size: 0.9em; }}
img.equation {{ vertical-align: middle; }}
li {{ margin-bottom: 0.3em; }}
.headline {{ font-size: 1.15em; font-weight: bold; }}
</style>
</head>
<body>
<h1>{title}</h1>
{label}{body}
</body>
</html>
"""
