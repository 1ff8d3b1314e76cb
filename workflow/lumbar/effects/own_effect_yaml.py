"""A YAML file as a mapping, with the line of every key; what YAML allows beside plain values is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lumbar.errors import InputError, Problems

MOST_BYTES = 100_000
_DEEPEST = 8
_COLLECTIONS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")


def read_mapping(path: Path) -> tuple[dict[str, Any], dict[str, int]]:
    """Read a YAML file.

    Returns
    -------
    dict
        Its content.
    dict of str to int
        Line of every key, e.g. ``"forms[0].equation"``.

    Raises
    ------
    InputError
        If it cannot be read, is no mapping, has a key twice, or uses anchors or tags.
    """
    import yaml

    try:
        data = path.read_bytes()
        if len(data) > MOST_BYTES:
            raise InputError(f"{path}: {len(data)} bytes; an effect takes at most {MOST_BYTES}")
        text = data.decode("utf-8")
        root = yaml.compose(text, Loader=_plain_loader())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); see improvement.effect_files"
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        said = getattr(error, "problem", None) or str(error) or "nested too deeply"
        raise InputError(f"{path}: {line}no YAML in UTF-8 ({said})") from error
    problems, lines = Problems(str(path)), {}
    content = _plain(root, "", 0, lines, problems)
    if not isinstance(content, dict):
        problems.add("", "no mapping", "name: …, mechanism: …, equation: …, parameters: …")
    problems.raise_if_any()
    return content, lines


def _plain_loader():
    import yaml

    class Plain(yaml.SafeLoader):
        """SafeLoader that takes a node once: anchors could make a small file huge."""

        def compose_node(self, parent, index):
            if self.check_event(yaml.AliasEvent):
                raise yaml.composer.ComposerError(
                    None, None, "anchors are not read here; write it out", self.peek_event().start_mark
                )
            return super().compose_node(parent, index)

    return Plain


def _plain(node, place: str, depth: int, lines: dict[str, int], problems: Problems) -> Any:
    """Value of a node, with the lines of its keys."""
    import yaml

    if depth > _DEEPEST:
        problems.add(f"line {node.start_mark.line + 1}, {place}", "nested too deeply")
        return None
    if isinstance(node, yaml.CollectionNode) and node.tag not in _COLLECTIONS:
        problems.add(
            f"line {node.start_mark.line + 1}, {place}", f"tag {node.tag!r}", "tags are not read here"
        )
        return None
    if isinstance(node, yaml.SequenceNode):
        return [
            _plain(item, f"{place}[{index}]", depth + 1, lines, problems)
            for index, item in enumerate(node.value)
        ]
    if not isinstance(node, yaml.MappingNode):
        try:
            return yaml.SafeLoader("").construct_object(node) if node is not None else None
        except yaml.YAMLError as error:
            problems.add(
                f"line {node.start_mark.line + 1}, {place}", getattr(error, "problem", None) or str(error)
            )
            return None
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = str(key_node.value)
        inner, line = f"{place}.{key}".strip("."), key_node.start_mark.line + 1
        if key in found:
            problems.add(
                f"line {line}, {inner}", f"is there twice, first in line {lines[inner]}", "once is allowed"
            )
        lines[inner] = line
        found[key] = _plain(value_node, inner, depth + 1, lines, problems)
    return found
