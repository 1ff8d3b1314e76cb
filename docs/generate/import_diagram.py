"""The library's packages and their imports as a diagram in ``docs/architecture.md``, renewed by ``make docs``.

An arrow that follows from two others is left out.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

from lumbar.base.files import write_text

DOCS = Path(__file__).resolve().parents[1]
LIBRARY = DOCS.parent / "workflow" / "lumbar"
PAGE = "architecture.md"
WITH_SUBPACKAGES = ("tissue", "lifting")
_BLOCK = re.compile(r"(<!-- imports: by \"make docs\" -->\n).*?(<!-- end -->)", flags=re.S)


def _package(module: str) -> tuple[str, ...]:
    """Return the package of a dotted name, e.g. ``("tissue", "models")``; empty outside of the library."""
    parts = module.split(".")
    if parts[0] != "lumbar" or len(parts) < 2 or not (LIBRARY / parts[1]).is_dir():
        return ()
    has_inner = len(parts) > 2 and parts[1] in WITH_SUBPACKAGES and LIBRARY.joinpath(*parts[1:3]).is_dir()
    return tuple(parts[1:3]) if has_inner else (parts[1],)


def imports() -> set[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return the pairs of packages of which the first imports the second."""
    pairs = set()
    for path in LIBRARY.rglob("*.py"):
        importer = _package(".".join(("lumbar", *path.relative_to(LIBRARY).with_suffix("").parts)))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                pairs.add((importer, _package(node.module)))
    return {(one, other) for one, other in pairs if one and other and one != other}


def _arrows(pairs: set[tuple[str, str]], prefix: str = "") -> list[str]:
    """Return the sorted arrows that do not follow from others."""
    below: dict[str, set[str]] = {}
    for one, other in pairs:
        below.setdefault(one, set()).add(other)

    def reached(package: str) -> set[str]:
        return set().union(*({other} | reached(other) for other in below.get(package, ())))

    return [
        f"  {prefix}{one} --> {prefix}{other}"
        for one, other in sorted(pairs)
        if not any(other in reached(between) for between in below[one] - {other})
    ]


def diagram() -> str:
    """Return the imports as a Mermaid diagram, from the command line down to the base."""
    every = imports()
    lines = ["```mermaid", "flowchart TD"]
    for package in WITH_SUBPACKAGES:
        inner = {
            (one[1], other[1])
            for one, other in every
            if one[0] == other[0] == package and one[1:] and other[1:]
        }
        drawn = {name for pair in inner for name in pair}
        names = sorted(path.parent.name for path in (LIBRARY / package).glob("*/__init__.py"))
        lines += [f"  subgraph {package}", *(f"    {package}.{name}" for name in names if name not in drawn)]
        lines += [*(f"  {arrow}" for arrow in _arrows(inner, f"{package}.")), "  end"]
    outer = {(one[0], other[0]) for one, other in every if one[0] != other[0]}
    return "\n".join([*lines, *_arrows(outer), "```", ""])


def page() -> str:
    """Return the page with the present imports."""
    text = (DOCS / PAGE).read_text(encoding="utf-8")
    return _BLOCK.sub(lambda block: block[1] + diagram() + block[2], text)


if __name__ == "__main__":
    write_text(DOCS / PAGE, page())
