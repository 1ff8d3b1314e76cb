"""The reference of all configuration keys, written from the schemas and the defaults.

``python -m lumbar.config.reference config/README.md`` renews the part of the page between its two markers; a test
fails when the page no longer says what the schemas say.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import yaml

from lumbar.files import write_text

START, END = "<!-- keys: start -->", "<!-- keys: end -->"


class _Schemas:
    """Schema files of a folder, and the references between and inside them."""

    def __init__(self, folder: Path):
        self.folder = folder

    def load(self, name: str) -> dict:
        return yaml.safe_load((self.folder / name).read_text(encoding="utf-8"))

    def resolve(self, schema: dict, document: dict) -> tuple[dict, dict]:
        """Follow references; return what they lead to and the document it stands in."""
        while "$ref" in schema:
            name, _, pointer = schema["$ref"].partition("#")
            beside = {key: value for key, value in schema.items() if key != "$ref"}
            schema = document = self.load(name) if name else document
            for part in filter(None, pointer.split("/")):
                schema = schema[part]
            schema = {**schema, **beside}
        return schema, document


def _allowed(schema: dict) -> str:
    if "enum" in schema:
        return ", ".join(f"`{item}`" for item in schema["enum"])
    kind = schema.get("type", "")
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    limits = [
        f"{sign} {schema[key]}"
        for key, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "<"),
        )
        if key in schema
    ]
    return " ".join([kind, ", ".join(limits)]).strip()


def keys(schema: dict, defaults, folder: Path) -> Iterator[tuple[str, str, str, str]]:
    """Yield key, allowed values, default and meaning of every key, in the schema's order.

    ``[]`` stands for each entry of a list, ``*`` for each name the user chooses.
    """
    yield from _keys(_Schemas(folder), schema, schema, defaults, "")


def _keys(schemas: _Schemas, schema: dict, document: dict, defaults, prefix: str):
    schema, document = schemas.resolve(schema, document)
    for name, entry in schema.get("properties", {}).items():
        value = defaults.get(name) if isinstance(defaults, dict) else None
        yield from _key(schemas, entry, document, value, f"{prefix}{name}")
    chosen = schema.get("additionalProperties")
    if isinstance(chosen, dict) and schemas.resolve(chosen, document)[0].get("properties"):
        yield from _keys(schemas, chosen, document, None, f"{prefix}*.")


def _key(schemas: _Schemas, entry: dict, document: dict, value, key: str):
    entry, document = schemas.resolve(entry, document)
    inside = entry.get("properties") or isinstance(entry.get("additionalProperties"), dict)
    if not inside or entry.get("description"):
        yield key, _allowed(entry), _default(value), entry.get("description", "")
    if inside:
        yield from _keys(schemas, entry, document, value, f"{key}.")
    items = entry.get("items")
    if isinstance(items, dict):
        yield from _keys(schemas, items, document, None, f"{key}[].")


def _default(value) -> str:
    """Scalars and lists of scalars in JSON; what is longer stands in the file itself."""
    if value is None or isinstance(value, dict):
        return ""
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        return ""
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def reference(root: Path) -> str:
    """Return the Markdown tables of all keys, one per section.

    Parameters
    ----------
    root : Path
        Folder of the project.
    """
    folder = root / "workflow" / "schemas"
    defaults = {}
    for name in ("config.yaml", "twin.yaml", "hidden_effects.yaml"):
        defaults.update(yaml.safe_load((root / "config" / name).read_text(encoding="utf-8")))
    schema = yaml.safe_load((folder / "config.schema.yaml").read_text(encoding="utf-8"))
    sections: dict[str, list[tuple[str, str, str, str]]] = {}
    for row in keys(schema, defaults, folder):
        top = row[0].split(".")[0].split("[")[0]
        nested = "$ref" in schema["properties"][top]
        sections.setdefault(top if nested else "study", []).append(row)
    lines = []
    for section, rows in sections.items():
        lines += [f"### {section}", "", "| key | allowed | default | meaning |", "|---|---|---|---|"]
        lines += [
            "| " + " | ".join([f"`{key}`", *(cell.replace("|", "\\|") for cell in rest)]) + " |"
            for key, *rest in rows
        ]
        lines.append("")
    return "\n".join(lines)


def renewed(page: str, root: Path) -> str:
    """Return a page with the part between the markers renewed."""
    before, rest = page.split(START)
    after = rest.split(END)[1]
    return f"{before}{START}\n{reference(root)}{END}{after}"


if __name__ == "__main__":
    target = Path(sys.argv[1]).resolve()
    write_text(target, renewed(target.read_text(encoding="utf-8"), target.parent.parent))
