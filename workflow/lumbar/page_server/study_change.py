"""A key set in a study's YAML without touching anything else, as a change that a person sees first."""

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from lumbar.base.errors import InputError
from lumbar.base.files import write_text
from lumbar.base.yaml_file import quoted


@dataclass(frozen=True)
class Change:
    """What a study's file holds and would hold, and files that would be written with it."""

    path: Path
    before: str
    after: str
    beside: Mapping[Path, str] = field(default_factory=dict)
    """Text of new files."""

    @property
    def diff(self) -> str:
        """The change as a unified diff, new files named below; empty where nothing changes."""
        name, lines = self.path.name, [self.before.splitlines(), self.after.splitlines()]
        told = [*difflib.unified_diff(*lines, name, name, lineterm="", n=2)]
        told += [f"new file {path} ({text.count(chr(10))} lines)" for path, text in self.beside.items()]
        return "\n".join(told)

    def write(self) -> None:
        """Write the new files, then the study, each whole.

        Raises
        ------
        InputError
            If the study was changed by somebody else meanwhile, or a new file is there already.
        """
        if self.path.read_text(encoding="utf-8") != self.before:
            raise InputError(
                f"{self.path}: changed since the difference was shown; nothing is written: look at it again"
            )
        for path in self.beside:
            if path.exists() or path.is_symlink():
                raise InputError(f"{path}: already there, and not written over; nothing is written")
        for path, text in self.beside.items():
            write_text(path, text)
        write_text(self.path, self.after)


def with_value(path: Path, way: Sequence[str | int], value: Any) -> Change:
    """Set one key of a YAML file; every other character stays.

    Parameters
    ----------
    way : sequence of str or int
        Sections, numbers of list entries and the key, e.g. ``("improvement", "record_sets", 1, "effects")``; sections that
        are not there are made, list entries must be there, but for the number after the last one.
    value : str, number, list or dict
        Written on one line; a list of mappings one entry per line.

    Raises
    ------
    InputError
        If the file is written in a way that this cannot change alone (an alias, a tag).
    """
    before = path.read_text(encoding="utf-8")
    try:
        content = yaml.safe_load(before)
        wanted = _merged(content, way, value)
        after = before if content == wanted else _edited(before, list(way), value)
        correct = yaml.safe_load(after) == wanted
    except (yaml.YAMLError, LookupError):
        correct = False
    if not correct:
        key = ".".join(map(str, way))
        raise InputError(
            f"{path}: {key} cannot be set without touching the rest of the file; write by hand {key}: {flow(value)}"
        )
    return Change(path, before, after)


def flow(value: Any) -> str:
    """YAML of a value on one line.

    Examples
    --------
    >>> flow({"name": "own", "effects": ["delay"], "file": "1: a.csv"})
    '{name: own, effects: [delay], file: "1: a.csv"}'
    """
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{flow(key)}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    return quoted(value) if isinstance(value, str) else json.dumps(value)


def _merged(content: Any, way: Sequence[str | int], value: Any) -> Any:
    """Content of a file with the value in its place."""
    if not way:
        return value
    first, rest = way[0], way[1:]
    if isinstance(first, int):
        if not isinstance(content, list):
            raise LookupError(first)
        entries = content
        inner = entries[first] if first < len(entries) else None
        return [*entries[:first], _merged(inner, rest, value), *entries[first + 1 :]]
    content = {} if content is None else content
    if not isinstance(content, dict):
        raise LookupError(first)
    return {**content, first: _merged(content.get(first), rest, value)}


def _edited(text: str, way: list[str | int], value: Any) -> str:
    """Text with the value in its place; whether that is right the caller sees by reading it."""
    node = yaml.compose(text, yaml.SafeLoader)
    key_node = None
    for depth, step in enumerate(way):
        found = _entry(node, step)
        if found is None:
            return _inserted(text, key_node, node, way[depth:], value)
        key_node, node = found
    return _replaced(text, key_node, node, value)


def _entry(node, step: str | int):
    """Key and value nodes of an entry of a mapping or list; None where there is none."""
    if isinstance(node, yaml.MappingNode):
        return next((item for item in node.value if item[0].value == step), None)
    if isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
        return None, node.value[step]
    return None


def _replaced(text: str, key, node, value: Any) -> str:
    """The text with another value of a key that is there; a comment behind it stays."""
    ends = text[: node.end_mark.index].rstrip()
    start = node.start_mark.index
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        indent = " " * (key.start_mark.column + 2)
        return text[: key.end_mark.index] + ":" + _lines(value, indent) + text[len(ends) :]
    return text[:start] + flow(value) + text[len(ends) :]


def _lines(entries: Sequence, indent: str) -> str:
    return "".join(f"\n{indent}- {_entry_text(entry, indent)}" for entry in entries)


def _entry_text(entry: Any, indent: str) -> str:
    """An entry of a list in lines: on one line, or with a line for each key where it holds lists or mappings of mappings."""
    if not isinstance(entry, Mapping) or not any(isinstance(item, list | Mapping) for item in entry.values()):
        return flow(entry)
    return f"\n{indent}  ".join(f"{flow(key)}: {flow(item)}" for key, item in entry.items())


def _inserted(text: str, key, node, way: list[str | int], value: Any) -> str:
    """The text with an entry more in the mapping or list that `node` is."""
    entries = node.value if isinstance(node, yaml.CollectionNode) else []
    if isinstance(node, yaml.SequenceNode):
        return _appended(text, node, value)
    if not entries:
        return _in_empty(text, key, node, way, value)
    if node.flow_style:
        name, content = entries[0]
        end = content.end_mark.index
        return f"{text[:end]}, {way[0]}: {flow(_nested(way[1:], value))}{text[end:]}"
    if key is None and node.start_mark.column == 0:
        return f"{text.rstrip()}\n\n{_block(way, value, '')}\n"
    # Below the first entry, its name in lists; where that takes several lines, above it.
    name, content = entries[0]
    indent = " " * name.start_mark.column
    if content.end_mark.line > content.start_mark.line or not isinstance(content, yaml.ScalarNode):
        first = name.start_mark.index
        return f"{text[:first]}{_block(way, value, indent).lstrip()}\n{indent}{text[first:]}"
    end = text.find("\n", content.end_mark.index)
    end = len(text) if end < 0 else end
    return f"{text[:end]}\n{_block(way, value, indent)}{text[end:]}"


def _appended(text: str, node: yaml.SequenceNode, value: Any) -> str:
    if not node.value:
        return text[: node.start_mark.index] + f"[{flow(value)}]" + text[node.end_mark.index :]
    last = node.value[-1]
    end = len(text[: last.end_mark.index].rstrip())
    if node.flow_style:
        return f"{text[:end]}, {flow(value)}{text[end:]}"
    line = text.find("\n", end)
    end = len(text) if line < 0 else line  # behind a comment
    return text[:end] + _lines([value], " " * node.start_mark.column) + text[end:]


def _in_empty(text: str, key, node, way: list[str | int], value: Any) -> str:
    """A section that is named and holds nothing, or a file that does."""
    if key is None:
        return f"{text.rstrip()}\n\n{_block(way, value, '')}\n".lstrip()
    block = _block(way, value, " " * (key.start_mark.column + 2))
    rest = text[node.end_mark.index :]
    return f"{text[: key.end_mark.index]}:\n{block}\n{rest.lstrip(': ').removeprefix(chr(10))}"


def _block(way: Sequence[str | int], value: Any, indent: str) -> str:
    """Lines that hold a value below its sections."""
    if len(way) == 1 and isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return f"{indent}{way[0]}:" + _lines(value, f"{indent}  ")
    if len(way) == 1:
        return f"{indent}{way[0]}: {flow(value)}"
    return f"{indent}{way[0]}:\n{_block(way[1:], value, indent + '  ')}"


def _nested(way: Sequence[str | int], value: Any) -> Any:
    return {way[0]: _nested(way[1:], value)} if way else value
