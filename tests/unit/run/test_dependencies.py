"""A rule depends on every library file its script imports, and on no other."""

import ast
from importlib.metadata import version
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


def test_every_data_file_of_a_package_is_a_dependency(dependencies, project):
    figures = project / "workflow" / "lumbar" / "publishing" / "figures"
    data = {path for path in figures.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert figures / "fonts" / "Arimo-Regular.ttf" in data
    assert data <= set(map(Path, dependencies.library_sources("analyse_survey.py")))


def test_versions_are_those_of_installed_packages(dependencies):
    versions = dependencies.package_versions()
    packages = {name: text for name, text in versions.items() if name != "python"}
    assert {"numpy", "scipy", "pyyaml", "matplotlib"} <= set(packages)
    assert not {"snakemake", "pytest"} & set(packages)
    assert packages == {name: version(name) for name in packages}


def test_another_version_of_a_package_changes_every_digest(dependencies, tmp_path, monkeypatch):
    before = dependencies.library_code("analyse_survey.py")
    (tmp_path / "numpy-0.1.dist-info").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(dependencies, "package_versions", dependencies.package_versions.__wrapped__)
    assert dependencies.package_versions()["numpy"] == "0.1"
    assert dependencies.library_code.__wrapped__("analyse_survey.py") != before


def test_no_import_statement_is_overlooked(dependencies, project):
    """Compare with the whole syntax tree of every file; a line of prose like an import may count too."""
    for path in sorted((project / "workflow").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        nodes = ast.walk(ast.parse(source))
        statements = {ast.dump(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)}
        found = {ast.dump(node) for node in dependencies._import_statements(source)}
        assert statements <= found, path
