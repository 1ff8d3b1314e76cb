"""Imports of the library run one way."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter

import pytest

PACKAGES = [
    ["cli"],
    ["page_server"],
    ["interface"],
    ["reports", "config"],
    ["body_model"],
    [
        "synthetic",
        "survey",
        "fmu",
        "haptics",
        "pushes",
        "stability",
        "measures",
        "diagnosis",
        "identification",
    ],
    ["lifting", "signals", "effects"],
    ["quality"],
    ["models", "records", "population"],
    ["settings"],
]
"""From the top down: what stands in a row imports no row above it."""


@pytest.fixture(scope="module")
def imports(project):
    """What every module imports: at once, late or for its types alone."""
    root = project / "workflow"
    files = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (root / "lumbar").rglob("*.py")
    }
    return {name: _imported(path, files) - {name} for name, path in files.items()}


def _imported(path, files) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {item.name for item in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found |= {f"{node.module}.{item.name}" for item in node.names}
    inner = {name for name in found if name in files}
    return {name for name in inner if not any(other.startswith(f"{name}.") for other in inner)}


def test_no_module_needs_itself_by_way_of_others(imports):
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_packages_stand_on_those_below(imports):
    row = {package: number for number, packages in enumerate(PACKAGES) for package in packages}
    floor = {name: row.get(name.split(".")[1], len(PACKAGES)) for name in imports if "." in name}
    del floor["lumbar.__main__"]
    assert set(row) == {name.split(".")[1] for name in floor if name.count(".") > 1}
    upward = [
        (name, other) for name in floor for other in imports[name] & set(floor) if floor[other] < floor[name]
    ]
    assert not upward
