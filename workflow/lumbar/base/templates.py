"""Pages and files from the templates (``*.jinja``) that lie beside the modules they belong to."""

import re
from functools import cache
from pathlib import Path

_HYPHEN = re.compile(r"(?<![\w.)])-(?=\d)")


def typeset_minus_signs(text: str) -> str:
    """Return a sentence with a minus sign before negative numbers, as pages and figures set them; ready HTML as it is."""
    return text if hasattr(text, "__html__") else _HYPHEN.sub("−", text)


@cache
def template(name: str):
    """Return a `jinja2.Template` that refuses names it does not know, and escapes what it is given but in YAML and plain text.

    Parameters
    ----------
    name : str
        Path below the library, e.g. ``"tissue/fmu/build/documentation.html.jinja"``.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parents[1]),
        autoescape=lambda name: not name.endswith((".yaml.jinja", ".txt.jinja")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["typeset_minus_signs"] = typeset_minus_signs
    return environment.get_template(name)
