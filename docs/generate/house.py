"""The rooms of the library and the arrows between them, drawn from the import statements into ``docs/architecture.md``.

``make docs`` writes what stands between the two comments of the page. An arrow that follows from two others is left out.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

from lumbar.base.files import write_text

DOCS = Path(__file__).resolve().parents[1]
LIBRARY = DOCS.parent / "workflow" / "lumbar"
PAGE = "architecture.md"
_BLOCK = re.compile(r"(<!-- rooms: by \"make docs\" -->\n).*?(<!-- end -->)", flags=re.S)


def _room(module: str) -> tuple[str, ...]:
    """Rooms of a dotted name, e.g. ``("tissue", "models")``; empty where it is none of the library's."""
    parts = module.split(".")
    if parts[0] != "lumbar" or len(parts) < 2 or not (LIBRARY / parts[1]).is_dir():
        return ()
    wing = LIBRARY / parts[1]
    inner = len(parts) > 2 and parts[1] in ("tissue", "lifting") and (wing / parts[2]).is_dir()
    return tuple(parts[1:3]) if inner else (parts[1],)


def arrows() -> set[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return the pairs of rooms of which the first imports the second."""
    found = set()
    for path in LIBRARY.rglob("*.py"):
        own = _room(".".join(("lumbar", *path.relative_to(LIBRARY).with_suffix("").parts)))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if own and isinstance(node, ast.ImportFrom) and node.module:
                other = _room(node.module)
                found |= {(own, other)} if other and other != own else set()
    return found


def _drawn(pairs: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Arrows that no way over another room replaces, sorted."""
    below = {
        room: {other for one, other in pairs if one == room}
        for room in {room for pair in pairs for room in pair}
    }

    def reached(room: str) -> set[str]:
        return set().union(*({other} | reached(other) for other in below[room]))

    return sorted(
        (one, other) for one, other in pairs if not any(other in reached(way) for way in below[one] - {other})
    )


def picture() -> str:
    """Return the picture as a Mermaid diagram, from the command line down to the base."""
    every = arrows()
    outer = {(one[0], other[0]) for one, other in every if one[0] != other[0]}
    lines = ["```mermaid", "flowchart TD"]
    for wing in ("tissue", "lifting"):
        inner = {
            (one[1], other[1])
            for one, other in every
            if one[0] == other[0] == wing and len(one) == len(other) == 2
        }
        alone = sorted(path.parent.name for path in (LIBRARY / wing).glob("*/__init__.py"))
        alone = [room for room in alone if not any(room in pair for pair in inner)]
        lines += [f"  subgraph {wing}", *(f"    {wing}.{room}" for room in alone)]
        lines += [*(f"    {wing}.{one} --> {wing}.{other}" for one, other in _drawn(inner)), "  end"]
    return "\n".join([*lines, *(f"  {one} --> {other}" for one, other in _drawn(outer)), "```", ""])


def page() -> str:
    """Return the page with the picture as the imports draw it today."""
    text = (DOCS / PAGE).read_text(encoding="utf-8")
    return _BLOCK.sub(lambda block: block[1] + picture() + block[2], text)


if __name__ == "__main__":
    write_text(DOCS / PAGE, page())
