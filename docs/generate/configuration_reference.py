"""The reference of all configuration keys and the JSON schema for editors, written from the settings themselves.

``make docs`` renews the pages, and the schema in the library; a test fails when they no longer say what the settings say.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lumbar.study
from lumbar.base.files import write_text
from lumbar.settings.lifting import SubjectSettings
from lumbar.settings.section import Section
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.validation import Key, defaults_of

DOCS = Path(__file__).resolve().parents[1]
SCHEMA = Path(lumbar.study.__file__).with_name("study.schema.json")
STUDY_PAGE = "study"
"""Page of the keys that belong to no section."""
_SHOWN_NAMES = 8


REQUIRED = object()
"""Default of a key that has none."""


def keys(section: Key, defaults: dict, prefix: str = "") -> Iterator[tuple[str, Key, Any]]:
    """Yield path, key and default of every key of a section, in its order.

    ``[]`` is any entry of a list, ``*`` any name that the user chooses. The default is `REQUIRED` if there is
    none.
    """
    for name, key in section.keys.items():
        value = defaults.get(name, REQUIRED)
        if "$ref" not in key.schema:
            yield f"{prefix}{name}", key, value
        for kind in key.types:
            if "properties" in kind.schema:
                yield from keys(
                    kind, value if isinstance(value, dict) else _defaults(kind), f"{prefix}{name}."
                )
            elif kind.schema.get("type") in ("array", "object"):
                mark, entry = "[]" if kind.schema["type"] == "array" else ".*", kind.find(0)
                if "$ref" in entry.schema:
                    yield from keys(entry, _defaults(entry.types[0]), f"{prefix}{name}{mark}.")


def _defaults(section: Key) -> dict:
    """Defaults that the schema of a section states."""
    return {name: key.schema["default"] for name, key in section.keys.items() if "default" in key.schema}


def _default(value: Any) -> str:
    """Scalars and lists of scalars in JSON, of mappings the names, of longer lists the number of entries."""
    if value is REQUIRED:
        return "required"
    if isinstance(value, dict):
        names = [*list(value)[:_SHOWN_NAMES], *(["…"] if len(value) > _SHOWN_NAMES else [])]
        return f"{{{', '.join(names)}}}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return ", ".join(item["name"] for item in value)
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def _rows(section: Key, defaults: dict, prefix: str) -> list[str]:
    cells = (
        [f"`{path}`", key.allowed, _default(value), key.meaning]
        for path, key, value in keys(section, defaults, prefix)
    )
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]


def _defined(section: type[Section]) -> str:
    """Name the file that defines the keys of a section; code that uses one is found by the last part of its name."""
    file = section.__module__.replace(".", "/")
    return f"Defined in `workflow/{file}.py` (`{section.__name__}`); code reads a key by the last part of its name."


_HEAD = ["| key | allowed | default | meaning |", "|---|---|---|---|"]


def pages() -> dict[str, str]:
    """Return the Markdown page of every section of a study by its file name, and an index of them."""
    study, defaults = Key.from_class(StudySettings), defaults_of(StudySettings)
    texts, index, top_level = {}, [], []
    for name in study.keys:
        section = StudySettings.model_fields[name].annotation
        if name == "subject":
            section = SubjectSettings
        if not (isinstance(section, type) and issubclass(section, Section)):
            top_level.append(name)
            continue
        meaning = " ".join((section.__doc__ or "").split())
        rows = _rows(Key.from_class(section), defaults[name] or defaults_of(section), f"{name}.")
        texts[f"{name}.md"] = "\n".join([f"# {name}", "", meaning, _defined(section), "", *_HEAD, *rows, ""])
        index.append(f"- [{name}]({name}.md): {meaning}")
    top = [row for row in _rows(study, defaults, "") if row.split("`")[1].split(".")[0] in top_level]
    introduction = "Keys of a study; each chapter has its own page. `[]` is an entry of a list, `*` a name of your choice."
    texts[f"{STUDY_PAGE}.md"] = "\n".join(["# study", "", introduction, "", *_HEAD, *top, "", *index, ""])
    return texts


def schema() -> str:
    """Return the JSON schema of a study's files, for editors, one definition a line.

    No key is required: files are laid over the defaults and over each other.
    """
    content = _stripped(StudySettings.model_json_schema())
    content = {"$schema": "https://json-schema.org/draft/2020-12/schema", **content}
    lines = [
        f'"{name}": {json.dumps(part, ensure_ascii=False)}' for name, part in content.pop("$defs").items()
    ]
    top = json.dumps(content, ensure_ascii=False)
    return top[:-1] + ', "$defs": {\n' + ",\n".join(lines) + "\n}}\n"


def _stripped(content: Any) -> Any:
    """Take titles, which only repeat names, and required keys off a schema."""
    if isinstance(content, list):
        return [_stripped(item) for item in content]
    if not isinstance(content, dict):
        return content
    return {
        name: {key: _stripped(item) for key, item in value.items()}
        if name == "properties"
        else _stripped(value)
        for name, value in content.items()
        if name not in ("title", "required")
    }


if __name__ == "__main__":
    for file_name, text in pages().items():
        write_text(DOCS / "config" / file_name, text)
    write_text(SCHEMA, schema())
