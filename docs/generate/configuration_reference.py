"""The reference of all configuration keys and the JSON schema for editors, written from the settings themselves.

``make docs`` renews the pages, and the schema in the library; a test fails when they no longer say what the settings say.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

import lumbar.study
from lumbar.base.files import write_text
from lumbar.settings.plain import name_of, plain
from lumbar.settings.study_settings import StudySettings
from lumbar.study.validation import KeyType, keys_of, section_of

DOCS = Path(__file__).resolve().parents[1]
SCHEMA = Path(lumbar.study.__file__).with_name("study.schema.json")
STUDY_PAGE = "study"
"""Page of the keys that belong to no section."""
_SHOWN_NAMES = 8


def keys(section: type, defaults: dict, prefix: str = "") -> Iterator[tuple[str, KeyType, Any]]:
    """Yield way, type and default of every key of a section, in its order.

    ``[]`` stands for each entry of a list, ``*`` for each name the user chooses. The default is `MISSING` where there
    is none.
    """
    for name, item in keys_of(section).items():
        value = defaults.get(name, MISSING)
        inner = section_of(item.kind)
        if inner is None or item.kind is not inner:
            yield f"{prefix}{name}", item, value
        if inner is not None:
            given = value if isinstance(value, dict) else defaults_of(inner) if value is None else {}
            yield from keys(inner, given, f"{prefix}{name}.")
        yield from _entries(item, f"{prefix}{name}")


def _entries(item: KeyType, way: str) -> Iterator[tuple[str, KeyType, Any]]:
    """Keys of the entries of a list or of names the user chooses, where these are sections."""
    for kind in (item.kind, *get_args(item.kind)):
        origin, arguments = get_origin(kind), get_args(kind)
        if origin in (tuple, dict):
            entry, mark = (arguments[0], "[]") if origin is tuple else (arguments[1], ".*")
            if is_dataclass(entry):
                yield from keys(entry, defaults_of(entry), f"{way}{mark}.")


def defaults_of(section: type) -> dict:
    """Defaults of the keys of a section that have one, as plain data."""
    found = {}
    for item in fields(section):
        if item.default is not MISSING:
            found[name_of(item)] = plain(item.default)
        elif item.default_factory is not MISSING:
            found[name_of(item)] = plain(item.default_factory())
    return found


def _default(value: Any) -> str:
    """Scalars and lists of scalars in JSON, of mappings the names, of longer lists the number of entries."""
    if value is MISSING:
        return "required"
    if isinstance(value, dict):
        names = [*list(value)[:_SHOWN_NAMES], *(["…"] if len(value) > _SHOWN_NAMES else [])]
        return f"{{{', '.join(names)}}}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return ", ".join(item["name"] for item in value)
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def _rows(section: type, defaults: dict, prefix: str) -> list[str]:
    cells = (
        [f"`{way}`", item.allowed, _default(value), item.meaning]
        for way, item, value in keys(section, defaults, prefix)
    )
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]


def _defined(section: type) -> str:
    """Where the keys of a section are defined; who reads one is found by its last part."""
    file = section.__module__.replace(".", "/")
    return f"Defined in `workflow/{file}.py` (`{section.__name__}`); code reads a key by the last part of its name."


_HEAD = ["| key | allowed | default | meaning |", "|---|---|---|---|"]


def pages() -> dict[str, str]:
    """Return the Markdown page of every section of a study by its file name, and an index of them."""
    defaults = defaults_of(StudySettings)
    texts, index, own = {}, [], []
    for name, item in keys_of(StudySettings).items():
        section = section_of(item.kind)
        if section is None or name == "data_source":
            own.append(name)
            continue
        meaning = " ".join((section.__doc__ or "").split())
        given = defaults.get(name)
        rows = _rows(section, given if isinstance(given, dict) else defaults_of(section), f"{name}.")
        texts[f"{name}.md"] = "\n".join([f"# {name}", "", meaning, _defined(section), "", *_HEAD, *rows, ""])
        index.append(f"- [{name}]({name}.md): {meaning}")
    top = [row for row in _rows(StudySettings, defaults, "") if row.split("`")[1].split(".")[0] in own]
    words = "What a study is; its chapters have pages of their own. `[]` stands for each entry of a list, `*` for a "
    words += "name of your choice."
    texts[f"{STUDY_PAGE}.md"] = "\n".join(["# study", "", words, "", *_HEAD, *top, "", *index, ""])
    return texts


def schema() -> str:
    """Return the JSON schema of a study's files, for editors, one definition a line.

    No key is required: files are laid over the defaults and over each other.
    """
    from pydantic import TypeAdapter

    content = _stripped(TypeAdapter(StudySettings).json_schema())
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
