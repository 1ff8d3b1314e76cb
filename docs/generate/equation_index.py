"""Which object of the library computes which equation of the thesis, from docstrings.

An object belongs to an equation when the first paragraph of its docstring names it, in the one spelling ``Eq. 4.7`` or
``Eqs 4.5–4.7``.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).resolve().parents[1]
LIBRARY = DOCS.parent / "workflow" / "lumbar"
_MENTION = re.compile(r"Eqs?\.? (\d\.\d+)((?:(?:–|, | and )\d\.\d+)*)")


class Entry(NamedTuple):
    """One equation and one object of the library."""

    equation: str
    """Number in the thesis."""
    module: str
    """Module of the object."""
    name: str
    """Name in the module, e.g. ``Class.method``."""


def entries() -> list[Entry]:
    """Return every equation with the objects that compute it, in the thesis's order."""
    listed = []
    for path in sorted(LIBRARY.rglob("*.py")):
        module = ".".join(("lumbar", *path.relative_to(LIBRARY).with_suffix("").parts))
        if module.startswith("lumbar.settings."):
            continue  # they name equations, and compute none
        for name, docstring in _docstrings(ast.parse(path.read_text(encoding="utf-8"))):
            paragraph = " ".join(docstring.split("\n\n")[0].split())
            listed += [Entry(number, module, name) for number in equations(paragraph)]
    return sorted(listed, key=lambda item: (_order(item.equation), item.module, item.name))


def equations(text: str) -> list[str]:
    """Return the numbers of the equations that a text names; a dash includes all between two."""
    numbers: list[str] = []
    for first, others in _MENTION.findall(text):
        numbers.append(first)
        for sign, number in re.findall(r"(–|, | and )(\d\.\d+)", others):
            numbers += between(numbers[-1], number)[1:] if sign == "–" else [number]
    return list(dict.fromkeys(numbers))


def between(first: str, last: str) -> list[str]:
    """Return the numbers of a chapter's equations from one to another."""
    chapter, low = _order(first)
    return [f"{chapter}.{number}" for number in range(low, _order(last)[1] + 1)]


def _order(number: str) -> tuple[int, int]:
    chapter, place = number.split(".")
    return int(chapter), int(place)


def _docstrings(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield the public functions, classes, methods and documented constants of a module with their docstrings."""
    for node, after in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            inner = node.body if isinstance(node, ast.ClassDef) else []
            owners = [
                ("", node),
                *((f"{node.name}.", item) for item in inner if isinstance(item, ast.FunctionDef)),
            ]
            for owner, item in owners:
                if (
                    not item.name.startswith("_")
                    and not node.name.startswith("_")
                    and ast.get_docstring(item)
                ):
                    yield owner + item.name, ast.get_docstring(item)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(after, ast.Expr):
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            if isinstance(target, ast.Name) and isinstance(after.value, ast.Constant):
                yield target.id, str(after.value.value)
