"""A YAML file read with the line of every key, and with every fault of it told by file and line."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lumbar.errors import Problems

LARGEST_SIZE, MOST_ENTRIES, DEEPEST = 1_000_000, 100_000, 40
"""Bytes, entries with every alias written out, and levels of nesting of a configuration file."""
_PLAIN = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")


@dataclass(frozen=True)
class YamlFile:
    """Content of one file.

    Attributes
    ----------
    path : str
        As messages name it.
    content : dict
    lines : dict of tuple to int
        Line of every key and every entry of a list, by the way to it: ``("tissue", "records", 0, "file")``.
    """

    path: str
    content: dict[str, Any] = field(default_factory=dict)
    lines: dict[tuple, int] = field(default_factory=dict)

    def line(self, way: tuple) -> int | None:
        """Line of a key, or of the nearest one above it that stands in the file."""
        return next(
            (self.lines[way[:end]] for end in range(len(way), 0, -1) if way[:end] in self.lines), None
        )


class _TooMuch(Exception):
    """The file is nested too deep, or its aliases stand for too much."""


class _YamlReader:
    """Builds content and lines from the nodes of one file."""

    def __init__(self, loader, path: str, problems: Problems):
        self.loader, self.path, self.problems = loader, path, problems
        self.lines: dict[tuple, int] = {}
        self.entries = 0

    def read(self, node, way: tuple = ()) -> Any:
        from yaml import MappingNode, ScalarNode
        from yaml.constructor import ConstructorError

        self.entries += 1
        if self.entries > MOST_ENTRIES or len(way) > DEEPEST:
            raise _TooMuch
        if isinstance(node, ScalarNode):
            return self.loader.construct_object(node)
        if node.tag not in _PLAIN:
            raise ConstructorError(None, None, f"tag {node.tag!r} is not allowed", node.start_mark)
        if isinstance(node, MappingNode):
            return self._mapping(node, way)
        return [self._entry(item, (*way, number)) for number, item in enumerate(node.value)]

    def _entry(self, node, way: tuple) -> Any:
        self.lines[way] = node.start_mark.line + 1
        return self.read(node, way)

    def _mapping(self, node, way: tuple) -> dict:
        first: dict[Any, int] = {}
        for name, _ in node.value:
            key, line = getattr(name, "value", None), name.start_mark.line + 1
            if isinstance(key, str) and key in first:
                words = f"key {'.'.join(map(str, (*way, key)))!r} stands twice"
                self.problems.add(f"{self.path}, lines {first[key]} and {line}", words, "keep one of them")
            elif isinstance(key, str):
                first[key] = line
        self.loader.flatten_mapping(node)  # merge keys
        content = {}
        for name, value in node.value:
            key = str(self.read(name, way))
            self.lines[(*way, key)] = name.start_mark.line + 1
            content[key] = self.read(value, (*way, key))
        return content


def read_yaml(path: Path, problems: Problems, name: str | None = None) -> YamlFile:
    """Read a mapping from a YAML file.

    Parameters
    ----------
    path : Path
    problems : Problems
        Takes what is wrong: no file, no UTF-8, no YAML, a key that stands twice, no mapping, too much nesting.
    name : str, optional
        How messages call the file; default its path.

    Returns
    -------
    YamlFile
        Empty where the file cannot be read.
    """
    import yaml

    name = name or str(path)
    try:
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except OSError as error:
        problems.add(name, "no such file" if isinstance(error, FileNotFoundError) else str(error.strerror))
        return YamlFile(name)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        problems.add(f"{name}, line {line}", found, "save the file in the encoding UTF-8")
        return YamlFile(name)
    if len(raw) > LARGEST_SIZE:
        problems.add(name, f"{len(raw)} bytes", f"settings are at most {LARGEST_SIZE} bytes long")
        return YamlFile(name)
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        reader = _YamlReader(loader, name, problems)
        content = reader.read(node) if node is not None else {}
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = " ".join(filter(None, (error.context, error.problem)))
        problems.add(f"{name}, line {mark.line + 1}" if mark else name, f"not valid YAML: {said}")
    except (yaml.YAMLError, ValueError) as error:
        problems.add(name, f"not valid YAML: {error}")
    except (_TooMuch, RecursionError):
        allowed = f"at most {DEEPEST} levels and {MOST_ENTRIES} entries, aliases written out"
        problems.add(name, "nested too deep, or aliases of aliases", allowed)
    else:
        if isinstance(content, dict):
            return YamlFile(name, content, reader.lines if node is not None else {})
        problems.add(name, "holds no settings", "'key: value' lines are needed")
    return YamlFile(name)


def check_readable(root: Path, names: Iterable[str]) -> None:
    """Refuse files that are no YAML, before Snakemake does: it names neither the file nor the line.

    Raises
    ------
    InputError
        With the faults of all files, if one of them cannot be read.
    """
    problems = Problems("configuration")
    read = [read_yaml(root / name, problems, name) for name in names]
    if not all(file.lines for file in read):
        problems.raise_if_any()
