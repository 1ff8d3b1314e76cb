"""A YAML file with the line of every key; every fault is reported by file and line."""

import json
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from lumbar.base.errors import InputError, Problems
from lumbar.base.files import require_file

MAX_BYTES = 1_000_000
"""Largest number of bytes of a configuration file."""
MAX_ENTRIES = 100_000
"""Largest number of entries of a file, with every alias written out."""
MAX_DEPTH = 40
"""Largest number of levels of nesting."""
_MAX_DIGITS = 100
"""Largest number of digits of a number; longer numbers cannot be used in computations."""
_PLAIN_TAGS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")
_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


@dataclass(frozen=True)
class YamlFile:
    """Content of one file; empty if it could not be read."""

    path: str
    """Name of the file in messages."""
    content: dict[str, Any] = field(default_factory=dict)
    lines: dict[tuple, int] = field(default_factory=dict)
    """Line of every key and every entry of a list, by its path: ``("tissue", "records", 0, "file")``."""

    def line(self, path: tuple) -> int | None:
        """Return the line of a key, or of its nearest parent that has a line."""
        return next(
            (self.lines[path[:end]] for end in range(len(path), 0, -1) if path[:end] in self.lines), None
        )

    def place(self, path: tuple) -> str:
        """Return file, line and key for a message, e.g. ``study.yaml, line 3: tissue.records.0.file``."""
        line = self.line(path)
        return f"{self.path}{f', line {line}' if line else ''}: {dotted_path(path)}"


def dotted_path(path: tuple) -> str:
    """Return the path of a key as text, e.g. ``tissue.records.0.file``."""
    return ".".join(map(str, path))


def parse_key_path(key: str) -> tuple:
    """Return the path of a key from its text; the inverse of `dotted_path`."""
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


def quote_yaml(text: str) -> str:
    """Return a YAML scalar that is read as this text, with quotes only if it needs them."""
    import yaml

    is_bare = re.fullmatch(r"[A-Za-z][\w.-]*( [\w.-]+)*", text) and yaml.safe_load(text) == text
    return text if is_bare else json.dumps(text, ensure_ascii=False)


class _TooLargeError(Exception):
    """Error for a file that is nested too deep, or with too many entries in its aliases."""


class _YamlReader:
    """Builds content and lines from the nodes of one file."""

    def __init__(self, loader, name: str, problems: Problems, anchors: bool):
        self.loader, self.problems, self.anchors = loader, problems, anchors
        self.file = YamlFile(name)
        self.visited: set[int] = set()
        self.entries = 0

    def read(self, node, path: tuple = ()) -> Any:
        from yaml import MappingNode, ScalarNode

        self.entries += 1
        if self.entries > MAX_ENTRIES or len(path) > MAX_DEPTH:
            raise _TooLargeError
        if id(node) in self.visited and not self.anchors:
            return self.add_problem(path, "an alias", "anchors are not read here; write it out")
        self.visited.add(id(node))
        if isinstance(node, ScalarNode):
            return self.read_scalar(node, path)
        if node.tag not in _PLAIN_TAGS:
            return self.add_problem(path, f"tag {node.tag!r}", "tags are not read here")
        if isinstance(node, MappingNode):
            return self.read_mapping(node, path)
        content = []
        for number, item in enumerate(node.value):
            self.file.lines[*path, number] = item.start_mark.line + 1
            content.append(self.read(item, (*path, number)))
        return content

    def add_problem(self, path: tuple, problem: str, allowed: str = "") -> None:
        self.problems.add(self.file.place(path), problem, allowed)

    def read_scalar(self, node, path: tuple) -> Any:
        from yaml.constructor import ConstructorError

        # Checked before the conversion: its time grows with the square of the number of digits.
        if node.tag in _NUMBER_TAGS and len(node.value) > _MAX_DIGITS:
            problem = f"a number of {len(node.value)} digits"
            return self.add_problem(path, problem, f"numbers have at most {_MAX_DIGITS} digits")
        try:
            return self.loader.construct_object(node)
        except ConstructorError as error:
            return self.add_problem(path, str(error.problem))
        except (LookupError, AttributeError):  # the constructor of a tag that the text does not fit
            problem = f"{node.value[:40]!r} under the tag {node.tag!r}"
            return self.add_problem(path, problem, "leave the tag out")

    def read_mapping(self, node, path: tuple) -> dict:
        first: dict[Any, int] = {}
        for name, _ in node.value:
            key, line = getattr(name, "value", None), name.start_mark.line + 1
            if isinstance(key, str) and first.setdefault(key, line) != line:
                place = f"{self.file.path}, lines {first[key]} and {line}"
                self.problems.add(place, f"duplicate key {dotted_path((*path, key))!r}", "keep one of them")
        self.loader.flatten_mapping(node)  # merge keys
        content = {}
        for name, value in node.value:
            key = str(self.read(name, path))
            self.file.lines[*path, key] = name.start_mark.line + 1
            content[key] = self.read(value, (*path, key))
        return content


def _bounded_loader(text: str):
    """Return PyYAML's loader, limited in the number of nodes and merged entries."""
    import yaml

    class BoundedLoader(yaml.SafeLoader):
        nodes = merged = 0

        def compose_node(self, parent, index):
            self.nodes += 1
            if self.nodes > MAX_ENTRIES:
                raise _TooLargeError
            return super().compose_node(parent, index)

        def flatten_mapping(self, node):
            super().flatten_mapping(node)
            # A mapping is flattened whenever it is merged, so thirty aliases of thirty aliases of … grow without limit.
            self.merged += len(node.value)
            if self.merged > MAX_ENTRIES:
                raise _TooLargeError

    return BoundedLoader(text)


def read_yaml(path: Path, problems: Problems, name: str | None = None, anchors: bool = True) -> YamlFile:
    """Read a mapping from a YAML file; it is empty if the file cannot be read.

    Parameters
    ----------
    path : Path
        The file.
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
        if len(raw) > MAX_BYTES:
            raise InputError(f"{len(raw)} bytes; at most {MAX_BYTES} are read")
        text = raw.decode("utf-8-sig")
        loader = _bounded_loader(text)
        reader = _YamlReader(loader, name, problems, anchors)
        node = loader.get_single_node()
        content = reader.read(node) if node is not None else {}
    except (InputError, OSError) as error:
        problems.add(name, getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: "))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        problem = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        problems.add(f"{name}, line {line}", problem, "save the file in the encoding UTF-8")
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        fault = " ".join(filter(None, (error.context, error.problem)))
        problems.add(f"{name}, line {mark.line + 1}" if mark else name, f"not valid YAML: {fault}")
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problems.add(f"{name}, line {line}", f"character #x{error.character:02x}", "text files have none")
    except (yaml.YAMLError, ValueError) as error:
        problems.add(name, f"not valid YAML: {error}")
    except (_TooLargeError, RecursionError):
        allowed = f"at most {MAX_DEPTH} levels and {MAX_ENTRIES} entries, aliases written out"
        problems.add(name, "nested too deep, or aliases of aliases", allowed)
    else:
        if isinstance(content, dict):
            return YamlFile(name, content, reader.file.lines)
        problems.add(name, "no mapping", "'key: value' lines are needed")
    return YamlFile(name)


def read_nested_scalars(value: Any) -> Any:
    """Return the value with the numbers, truth values and nulls that its nested text spells in YAML.

    Snakemake reads nested values of ``--config`` as text.

    Examples
    --------
    >>> read_nested_scalars({"confidence": "0.9", "scale_labels": ["low", "high"]})
    {'confidence': 0.9, 'scale_labels': ['low', 'high']}
    """
    import yaml

    if isinstance(value, dict):
        return {key: read_nested_scalars(item) for key, item in value.items()}
    if isinstance(value, list):
        return [read_nested_scalars(item) for item in value]
    try:
        scalar = yaml.safe_load(value) if isinstance(value, str) else value
    except yaml.YAMLError:
        return value
    return scalar if scalar is None or isinstance(scalar, bool | int | float) else value


def shipped_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a YAML file of the library, unchecked; libyaml is ten times as fast and is used if available."""
    import yaml

    return yaml.load(path.read_bytes(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def shipped_names(path: Path, section: str) -> SimpleNamespace:
    """Return as attributes the entries of one section of a YAML file of the library."""
    return SimpleNamespace(**shipped_yaml(path)[section])


def check_readable(root: Path, names: Iterable[str]) -> None:
    """Check that files are YAML before Snakemake reads them: Snakemake's error names neither file nor line.

    Raises
    ------
    InputError
        If a file cannot be read, with the faults of all files.
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
