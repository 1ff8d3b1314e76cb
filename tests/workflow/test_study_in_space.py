"""Recordings of several axes become a study, and plain `snakemake` makes all of it."""

import json

import pytest

import lumbar
from refusing import has_tokens
from running import copy_project, snakemake
from space_records import TABLE


@pytest.mark.nightly
def test_imported_study_of_several_axes_makes_its_report(tmp_path):
    (tmp_path / "bench.csv").write_text(TABLE)
    lumbar.import_recordings([tmp_path / "bench.csv"]).save(tmp_path / "lab")
    project = copy_project(tmp_path / "project")
    quick = tmp_path / "quick.yaml"
    quick.write_text("improvement: {base: LE, most_effects: 1, propose_law: false}\n")
    run = snakemake(project, "--cores", "1", "--configfile", str(tmp_path / "lab" / "study.yaml"), str(quick))
    assert has_tokens(run.whole().text, "Table 3.1…one axis")
    results = project / "results" / "lab"
    diagnosis = json.loads((results / "improvement" / "tissue" / "diagnosis.json").read_text())
    assert diagnosis["selected"] == ["coulomb_friction"]
    page = (results / "report.html").read_text(encoding="utf-8")
    assert "position x, y, z (mm), force x, y, z (N)" in page
    assert 'id="principal_axes-tissue"' in page
