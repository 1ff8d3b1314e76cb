"""The lock, the conda environment and the package description agree."""

import json
import re
import runpy
import tomllib
from importlib.metadata import distribution, distributions, version

import pytest
import yaml
from jsonschema import Draft202012Validator
from packaging.requirements import Requirement

from generate.configuration_reference import SCHEMA, pages, schema


def lock(project):
    return (project / "envs" / "lock.txt").read_text(encoding="utf-8")


def pins(project):
    return dict(re.findall(r"^([A-Za-z0-9._-]+)==([^ ;\\]+)", lock(project), flags=re.M))


def test_every_locked_version_has_hashes_and_no_address(project):
    requirements = re.split(r"\n(?=[A-Za-z0-9])", lock(project).strip())
    assert len(requirements) > 50
    assert all("--hash=sha256:" in requirement for requirement in requirements)
    assert "://" not in lock(project)


def test_every_dependency_is_locked(project):
    description = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = [*description["project"]["dependencies"], *description["dependency-groups"]["dev"]]
    names = {re.match(r"[A-Za-z0-9._-]+", requirement).group().lower() for requirement in wanted}
    assert names <= set(pins(project))


def named(text: str) -> set[str]:
    """Names of packages as indices compare them."""
    names = re.findall(r"^([A-Za-z0-9._-]+)==", text, flags=re.M)
    return {re.sub(r"[-_.]+", "-", name).lower() for name in names}


def test_packages_whose_metadata_state_no_licence_are_listed(project):
    silent = set()
    for package in distributions():
        facts = package.metadata
        stated = [item for item in facts.get_all("Classifier", []) if item.startswith("License :: ")]
        stated += [facts[key] for key in ("License", "License-Expression") if facts[key]]
        if not set(stated) - {"License :: OSI Approved", "UNKNOWN"}:
            silent |= named(f"{facts['Name']}==")
    table = (project / "envs" / "licences.md").read_text(encoding="utf-8")
    listed = named(re.sub(r"^\| ([\w-]+) \|", r"\1==", table, flags=re.M)) - {"package"}
    assert listed == silent & named(lock(project))


def test_images_are_named_by_digest(project):
    container = (project / "envs" / "Dockerfile").read_text(encoding="utf-8")
    images = re.findall(r"^FROM (\S+)", container, flags=re.M)
    assert images and all(re.search(r"@sha256:[0-9a-f]{64}$", image) for image in images)


def required(names: set[str]) -> set[str]:
    """Names of installed packages that these need, at any depth, on this machine."""
    found, pending = set(), set(names)
    while pending:
        name = pending.pop()
        found.add(name)
        for text in distribution(name).requires or ():
            requirement = Requirement(text)
            needed = re.sub(r"[-_.]+", "-", requirement.name).lower()
            if needed not in found and (not requirement.marker or requirement.marker.evaluate({"extra": ""})):
                pending.add(needed)
    return found


def test_runtime_has_what_the_package_needs_and_no_tool_of_development(project):
    description = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = {Requirement(text).name for text in description["project"]["dependencies"]}
    if any(version(name) != pins(project)[name] for name in wanted):
        pytest.skip("the installed packages are not those of the lock")
    runtime = named((project / "envs" / "runtime-lock.txt").read_text(encoding="utf-8"))
    assert required(wanted) <= runtime < named(lock(project))
    assert not runtime & {"pytest", "playwright", "ruff", "mypy", "snakefmt"}


def test_derived_files_are_up_to_date(project):
    derive = runpy.run_path(str(project / "envs" / "derive.py"))
    text = {path.name: path.read_text(encoding="utf-8") for path in (project / "envs").iterdir()}
    runtime, whole = text["runtime-lock.txt"], text["lock.txt"]
    assert derive["supported"](whole) == whole
    assert derive["runtime_lock"](runtime, whole) == runtime
    assert derive["build_lock"](whole) == text["build-lock.txt"]
    assert derive["conda_environment"](runtime, whole) == text["lumbar.yaml"]


def test_reference_and_schema_equal_the_settings(project):
    files = {
        path.name: path.read_text(encoding="utf-8") for path in (project / "docs" / "config").glob("*.md")
    }
    assert files == pages(), "run: make docs"
    assert SCHEMA.read_text(encoding="utf-8") == schema(), "run: make docs"


def test_editors_find_the_schema_and_accept_every_study(project):
    files = [*project.glob("config/**/*.yaml"), *project.glob("examples/**/study.yaml")]
    assert len(files) > 10
    for path in files:
        text = path.read_text(encoding="utf-8")
        named = path.parent / text.splitlines()[0].removeprefix("# yaml-language-server: $schema=")
        schema = Draft202012Validator(json.loads(named.read_text(encoding="utf-8")))
        assert not [error.message for error in schema.iter_errors(yaml.safe_load(text))], path
    for wrong in ({"survey": {"colour": 1}}, {"seed": -1}, {"tissue": {"training": ["a", "a"]}}):
        assert not schema.is_valid(wrong)
