"""The workflow as a graph: targets, artefacts, house rules, format."""

import csv
import json

import pytest

import lumbar
from running import copy_project, snakemake

CHAPTERS = lumbar.StudySettings.model_json_schema()["properties"]["chapters"]["items"]["enum"]
DEFAULT_CHAPTERS = [name for name in CHAPTERS if name != "population"]


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    return copy_project(tmp_path_factory.mktemp("fresh"))


def artefacts(project):
    with (project / "config" / "artefacts.tsv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream, delimiter="\t"))


def test_sheet_follows_the_chapters_in_order(project):
    order = [CHAPTERS.index(row["chapter"]) for row in artefacts(project)]
    assert order == sorted(order)


def test_chapters_and_artefacts_are_targets(fresh):
    """In one call: a single name that is no target, or one without its inputs, would end it."""
    targets = [*DEFAULT_CHAPTERS, "table_3_1", "figure_4_4"]
    run = snakemake(fresh, "--dry-run", "--cores", "1", *targets).whole()
    assert {target: run.jobs.get(target) for target in targets} == dict.fromkeys(targets, 1)


def test_braces_in_free_text_are_text(tmp_path):
    folder, text = copy_project(tmp_path / "project"), "{input.__class__} {lift} {nothing} {} {"
    person = folder / "config" / "subjects" / "novice.yaml"
    content = person.read_text(encoding="utf-8")
    person.write_text(content.replace("experience: novice", f"experience: '{text}'"), encoding="utf-8")
    free = {"title": text, "survey": {"statement": text}, "runtime": {"compiler_cache": text}}
    free["stability"] = {"compare": {"groups": [text, "expert"]}}
    (tmp_path / "study.yaml").write_text(json.dumps(free), encoding="utf-8")
    snakemake(
        folder, "--dry-run", "--cores", "1", "all", "report", "--configfile", str(tmp_path / "study.yaml")
    ).whole()


def test_one_person_alone_runs_only_that_person(fresh):
    # With the reasons, which name files.
    # The profile of the cluster needs no plugin for a run on this machine.
    person = ("--configfile", "config/subjects/expert.yaml", "--workflow-profile", "profiles/slurm")
    person += ("--executor", "local", "--config", "survey={confidence: 0.9}")
    run = snakemake(fresh, "--dry-run", "--cores", "1", "stability", "--quiet", "host", *person).whole()
    assert "results/expert/" in run.text
    assert "novice" not in run.text
    assert "results/thesis/" not in run.text


def test_no_rule_uses_a_shell(project):
    for path in (project / "workflow" / "rules").glob("*.smk"):
        assert "shell:" not in path.read_text(encoding="utf-8"), (
            f"{path.name}: configuration must not reach a shell"
        )
