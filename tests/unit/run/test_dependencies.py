"""A rule depends on every library file its script imports, and on no other."""

import ast
from pathlib import Path

import pytest


@pytest.fixture
def dependencies(project, monkeypatch):
    monkeypatch.syspath_prepend(str(project / "workflow"))
    from run import dependencies

    return dependencies


def test_imports_are_followed_at_any_depth(dependencies, project):
    library = project / "workflow" / "lumbar"
    sources = set(map(Path, dependencies.library_sources("analyse_survey.py")))
    for module in (
        "base/files.py", "tables/table.py", "tissue/survey/paired_analysis.py", "tables/table.html.jinja",
        "records/ratings.py", "tissue/survey/__init__.py", "__init__.py",
    ):  # fmt: skip
        assert library / module in sources
    assert project / "workflow" / "scripts" / "job.py" in sources
    assert library / "publishing" / "figures" / "style.py" in sources
    assert not any("diagnosis" in path.parts for path in sources)


def test_catalogue_effect_is_a_dependency_of_diagnosis(dependencies, project):
    effects = project / "workflow" / "lumbar" / "tissue" / "effects"
    sources = set(map(Path, dependencies.library_sources("diagnose_records.py")))
    assert set(effects.glob("*/*.yaml")) <= sources
    assert not any(
        effects in path.parents for path in map(Path, dependencies.library_sources("analyse_survey.py"))
    )


def test_no_import_statement_is_overlooked(dependencies, project):
    """Compare with the whole syntax tree of every file; a line of prose like an import may count too."""
    for path in sorted((project / "workflow").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        nodes = ast.walk(ast.parse(source))
        statements = {ast.dump(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)}
        found = {ast.dump(node) for node in dependencies._import_statements(source)}
        assert statements <= found, path
