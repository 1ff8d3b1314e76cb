"""Templates (``*.jinja``) of pages and files, each in the folder of the module that uses it."""

import re
from functools import cache
from pathlib import Path

_HYPHEN = re.compile(r"(?<![\w.)])-(?=\d)")


def typeset_minus_signs(text: str) -> str:
    """Return a sentence with a minus sign before negative numbers, for pages and figures; HTML is returned unchanged."""
    return text if hasattr(text, "__html__") else _HYPHEN.sub("−", text)


@cache
def template(name: str):
    """Return a `jinja2.Template` that rejects unknown names and escapes values, except in YAML and plain text.

    In a template ``file_text("page_server/own_recordings.css")`` is the text of a style sheet or script.

    `name` is a path below the library, e.g. ``"tissue/fmu/build/documentation.html.jinja"``.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    library = Path(__file__).parents[1]
    environment = Environment(
        loader=FileSystemLoader(library),
        autoescape=lambda name: not name.endswith((".yaml.jinja", ".txt.jinja")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.globals["file_text"] = lambda path: Markup(
        (library / path).read_text(encoding="utf-8").rstrip("\n")
    )
    environment.filters["typeset_minus_signs"] = typeset_minus_signs
    return environment.get_template(name)
