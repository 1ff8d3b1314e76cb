"""A YAML file with the line of every key; every fault is reported by file and line."""

import json
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import require_file

LARGEST_SIZE, MOST_ENTRIES, DEEPEST = 1_000_000, 100_000, 40
"""Bytes, entries with every alias written out, and levels of nesting of a configuration file."""
_MOST_DIGITS = 100
"""Digits of a number; any more cannot be computed with."""
_PLAIN = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


@dataclass(frozen=True)
class YamlFile:
    """Content of one file; empty if it could not be read."""

    path: str
    """Name in messages."""
    content: dict[str, Any] = field(default_factory=dict)
    lines: dict[tuple, int] = field(default_factory=dict)
    """Line of every key and every entry of a list, by its path: ``("tissue", "records", 0, "file")``."""

    def line(self, way: tuple) -> int | None:
        """Return the line of a key, or of the nearest one above it in the file."""
        return next(
            (self.lines[way[:end]] for end in range(len(way), 0, -1) if way[:end] in self.lines), None
        )

    def place(self, way: tuple) -> str:
        """Return file, line and key for a message, e.g. ``study.yaml, line 3: tissue.records.0.file``."""
        line = self.line(way)
        return f"{self.path}, line {line}: {dotted_path(way)}" if line else f"{self.path}: {dotted_path(way)}"


def dotted_path(way: tuple) -> str:
    """Return the path of a key as text, e.g. ``tissue.records.0.file``."""
    return ".".join(map(str, way))


def parse_key_path(key: str) -> tuple:
    """Return the path of a key from its text; the inverse of `dotted_path`."""
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


_BARE = re.compile(r"[A-Za-z][\w.-]*( [\w.-]+)*")


def quote_yaml(text: str) -> str:
    """Return a YAML scalar that reads as this text, with quotes only if it needs them."""
    import yaml

    bare = _BARE.fullmatch(text) and yaml.safe_load(text) == text
    return text if bare else json.dumps(text, ensure_ascii=False)


class _TooMuch(Exception):
    """The file is nested too deep, or its aliases stand for too much."""


class _YamlReader:
    """Builds content and lines from the nodes of one file."""

    def __init__(self, loader, path: str, problems: Problems, anchors: bool):
        self.loader, self.problems, self.anchors = loader, problems, anchors
        self.file = YamlFile(path)
        self.seen: set[int] = set()
        self.entries = 0

    def read(self, node, way: tuple = ()) -> Any:
        from yaml import MappingNode, ScalarNode
        from yaml.constructor import ConstructorError

        self.entries += 1
        if self.entries > MOST_ENTRIES or len(way) > DEEPEST:
            raise _TooMuch
        if id(node) in self.seen and not self.anchors:
            self._problem(way, "an alias", "anchors are not read here; write it out")
            return None
        self.seen.add(id(node))
        if isinstance(node, ScalarNode):
            # Before they are computed with: sixty minutes of sixty minutes of … take the square of their number.
            if node.tag in _NUMBERS and len(node.value) > _MOST_DIGITS:
                found = f"a number of {len(node.value)} digits"
                self._problem(way, found, f"numbers have at most {_MOST_DIGITS} digits")
                return None
            try:
                return self.loader.construct_object(node)
            except ConstructorError as error:
                self._problem(way, str(error.problem))
            except (LookupError, AttributeError):  # the constructor of a tag that the text does not fit
                self._problem(way, f"{node.value[:40]!r} under the tag {node.tag!r}", "leave the tag out")
            return None
        if node.tag not in _PLAIN:
            self._problem(way, f"tag {node.tag!r}", "tags are not read here")
            return None
        if isinstance(node, MappingNode):
            return self._mapping(node, way)
        return [self._entry(item, (*way, number)) for number, item in enumerate(node.value)]

    def _problem(self, way: tuple, found: str, allowed: str = "") -> None:
        self.problems.add(self.file.place(way), found, allowed)

    def _entry(self, node, way: tuple) -> Any:
        self.file.lines[way] = node.start_mark.line + 1
        return self.read(node, way)

    def _mapping(self, node, way: tuple) -> dict:
        first: dict[Any, int] = {}
        for name, _ in node.value:
            key, line = getattr(name, "value", None), name.start_mark.line + 1
            if isinstance(key, str) and key in first:
                words = f"duplicate key {dotted_path((*way, key))!r}"
                self.problems.add(
                    f"{self.file.path}, lines {first[key]} and {line}", words, "keep one of them"
                )
            elif isinstance(key, str):
                first[key] = line
        self.loader.flatten_mapping(node)  # merge keys
        content = {}
        for name, value in node.value:
            key = str(self.read(name, way))
            self.file.lines[(*way, key)] = name.start_mark.line + 1
            content[key] = self.read(value, (*way, key))
        return content


def _bounded_loader(text: str):
    """Return PyYAML's loader, which stops at a file with too many nodes or merged entries."""
    import yaml

    class Bounded(yaml.SafeLoader):
        nodes = merged = 0

        def compose_node(self, parent, index):
            self.nodes += 1
            if self.nodes > MOST_ENTRIES:
                raise _TooMuch
            return super().compose_node(parent, index)

        def flatten_mapping(self, node):
            super().flatten_mapping(node)
            # A mapping is flattened each time that it is to be merged, before that: thirty aliases of thirty aliases of ….
            self.merged += len(node.value)
            if self.merged > MOST_ENTRIES:
                raise _TooMuch

    return Bounded(text)


def read_yaml(path: Path, problems: Problems, name: str | None = None, anchors: bool = True) -> YamlFile:
    """Read a mapping from a YAML file; it is empty if the file cannot be read.

    Parameters
    ----------
    problems : Problems
        Collects the faults: no file, no UTF-8, no YAML, a tag, a duplicate key, no mapping, too much nesting.
    name : str, optional
        Name of the file in messages; default its path.
    anchors : bool
        Whether aliases of anchors are allowed.
    """
    import yaml

    name = name or str(path)
    try:
        require_file(path)
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except InputError as error:
        problems.add(name, str(error).removeprefix(f"{path}: "))
        return YamlFile(name)
    except OSError as error:
        problems.add(name, str(error.strerror))
        return YamlFile(name)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        problems.add(f"{name}, line {line}", found, "save the file in the encoding UTF-8")
        return YamlFile(name)
    if len(raw) > LARGEST_SIZE:
        problems.add(name, f"{len(raw)} bytes", f"at most {LARGEST_SIZE} are read")
        return YamlFile(name)
    try:
        loader = _bounded_loader(text)
        reader = _YamlReader(loader, name, problems, anchors)
        node = loader.get_single_node()
        content = reader.read(node) if node is not None else {}
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = " ".join(filter(None, (error.context, error.problem)))
        problems.add(f"{name}, line {mark.line + 1}" if mark else name, f"not valid YAML: {said}")
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problems.add(f"{name}, line {line}", f"character #x{error.character:02x}", "files of text have none")
    except (yaml.YAMLError, ValueError) as error:
        problems.add(name, f"not valid YAML: {error}")
    except (_TooMuch, RecursionError):
        allowed = f"at most {DEEPEST} levels and {MOST_ENTRIES} entries, aliases written out"
        problems.add(name, "nested too deep, or aliases of aliases", allowed)
    else:
        if isinstance(content, dict):
            return replace(reader.file, content=content)
        problems.add(name, "no mapping", "'key: value' lines are needed")
    return YamlFile(name)


def shipped_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a file of the library, by libyaml if available, in a tenth of the time; tests check it."""
    import yaml

    return yaml.load(path.read_bytes(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def shipped_names(path: Path, section: str) -> SimpleNamespace:
    """Return the entries of a section of such a file as attributes."""
    return SimpleNamespace(**shipped_yaml(path)[section])


def check_readable(root: Path, names: Iterable[str]) -> None:
    """Check that files are YAML, before Snakemake reads them: its error names neither the file nor the line.

    Raises
    ------
    InputError
        With the faults of all files, if one of them cannot be read.
    """
    problems = Problems("configuration")
    read = [read_yaml(root / name, problems, name) for name in names]
    if not all(file.lines for file in read):
        problems.raise_if_any()


if __name__ == "__main__":
    try:
        check_readable(Path(), sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
