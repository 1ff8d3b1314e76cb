"""The house's walls: imports of the library run one way, and its two wings know nothing of each other."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOMS = [
    ["cli"],
    ["page_server"],
    ["interface"],
    ["publishing"],
    ["study"],
    ["tissue", "lifting", "twin"],
    ["records"],
    ["tables"],
    ["settings"],
    ["base"],
]
"""From the top down: what stands in a row imports no row above it and nothing beside it.

The twin, too, uses no code that analyses it."""
TISSUE = [
    ["haptics"],
    ["fmu", "diagnosis", "survey"],
    ["identification"],
    ["signals", "effects"],
    ["models"],
]
LIFTING = [["stability"], ["measures"], ["movement"], ["quality"]]
"""The rooms of the two wings, likewise."""


def _module(path: Path, root: Path) -> str:
    return ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def _named(path: Path) -> set[str]:
    """Every module that a file imports, at once, late or for its types alone, and every name it takes from one."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found |= {f"{node.module}.{item.name}" for item in node.names}
    return found


@pytest.fixture(scope="module")
def named(project):
    """What every module of the library names in its import statements."""
    root = project / "workflow"
    return {_module(path, root): _named(path) for path in (root / "lumbar").rglob("*.py")}


@pytest.fixture(scope="module")
def imports(named):
    """The library's own modules that every module imports."""
    inner = {name: others & named.keys() - {name} for name, others in named.items()}
    return {
        name: {other for other in others if not any(longer.startswith(f"{other}.") for longer in others)}
        for name, others in inner.items()
    }


def _arrows(imports, inside: str) -> set[tuple[str, str]]:
    """Pairs of rooms of a package of which the first imports the second."""

    def room(module: str) -> str:
        return module.removeprefix(f"{inside}.").split(".")[0] if module.startswith(f"{inside}.") else ""

    pairs = {(room(name), room(other)) for name, others in imports.items() for other in others}
    return {(one, other) for one, other in pairs if one and other and one != other} - {("__main__", "cli")}


def test_imports_have_no_cycle(imports):
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_library_has_only_these_packages(project):
    library = project / "workflow" / "lumbar"
    rooms = {path.parent.name for path in library.glob("*/__init__.py")}
    assert rooms == {room for row in ROOMS for room in row}
    assert {path.stem for path in library.glob("*.py")} == {"__init__", "__main__"}


@pytest.mark.parametrize(
    ("inside", "rows"), [("lumbar", ROOMS), ("lumbar.tissue", TISSUE), ("lumbar.lifting", LIFTING)]
)
def test_arrows_run_downwards(imports, inside, rows):
    row = {room: number for number, rooms in enumerate(rows) for room in rooms}
    arrows = _arrows(imports, inside)
    assert {room for arrow in arrows for room in arrow} <= row.keys()
    assert not {(room, other) for room, other in arrows if row[other] <= row[room]}


def test_library_imports_nothing_of_the_workflow(named):
    """Neither of Snakemake and what serves it alone, nor of the scripts."""
    for name, others in named.items():
        assert not {other for other in others if other.split(".")[0] in ("run", "job", "snakemake")}, name
