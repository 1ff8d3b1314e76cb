"""Chosen effects written into a study's YAML, as a change that a person sees first."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from lumbar.errors import InputError
from lumbar.files import write_text

SECTION, KEY = "improvement", "effects"


@dataclass(frozen=True)
class Change:
    """What a study's file holds and would hold.

    Attributes
    ----------
    path : pathlib.Path
    before, after : str
    """

    path: Path
    before: str
    after: str

    @property
    def diff(self) -> str:
        """The change as a unified diff; empty where nothing changes."""
        lines = difflib.unified_diff(
            self.before.splitlines(),
            self.after.splitlines(),
            self.path.name,
            self.path.name,
            lineterm="",
            n=2,
        )
        return "\n".join(lines)

    def write(self) -> None:
        """Write the file whole.

        Raises
        ------
        InputError
            If the file was changed by somebody else meanwhile.
        """
        if self.path.read_text(encoding="utf-8") != self.before:
            raise InputError(
                f"{self.path}: changed since the difference was shown; nothing is written: look at it again"
            )
        write_text(self.path, self.after)


def keep_effects(path: Path, effects: Sequence[str]) -> Change:
    """Set ``improvement.effects`` in a study's file; every other character stays.

    Parameters
    ----------
    path : pathlib.Path
    effects : sequence of str
        In the order in which they are added.

    Raises
    ------
    InputError
        If the file is written in a way that this cannot change alone (a mapping in braces, an alias).
    """
    before = path.read_text(encoding="utf-8")
    after = _edited(before, f"[{', '.join(effects)}]")
    wanted = yaml.safe_load(before) or {}
    wanted[SECTION] = {**(wanted.get(SECTION) or {}), KEY: list(effects)}
    try:
        correct = yaml.safe_load(after) == wanted
    except yaml.YAMLError:
        correct = False
    if not correct:
        raise InputError(
            f"{path}: {SECTION}.{KEY} cannot be set without touching the rest of the file; write by hand "
            f"{SECTION}: {{{KEY}: [{', '.join(effects)}]}}"
        )
    return Change(path, before, after)


def _edited(text: str, value: str) -> str:
    """Text with the value in its place; whether that is right the caller sees by reading it."""
    section = _entry(yaml.compose(text, yaml.SafeLoader), SECTION)
    if section is None:
        return f"{text.rstrip()}\n\n{SECTION}:\n  {KEY}: {value}\n".lstrip()
    name, content = section
    entry = _entry(content, KEY)
    if entry is not None:
        old = entry[1]
        ends = text[: old.end_mark.index].rstrip()
        return text[: old.start_mark.index] + value + text[len(ends) :]
    if not isinstance(content, yaml.MappingNode) or not content.value:  # "improvement:" without content
        return (
            f"{text[: name.end_mark.index]}:\n  {KEY}: {value}\n{text[content.end_mark.index :].lstrip(': ')}"
        )
    first = content.value[0][0].start_mark
    return f"{text[: first.index]}{KEY}: {value}\n{' ' * first.column}{text[first.index :]}"


def _entry(node, name: str):
    """Key and value nodes of an entry of a mapping; None where there is none."""
    if not isinstance(node, yaml.MappingNode):
        return None
    return next((item for item in node.value if item[0].value == name), None)
