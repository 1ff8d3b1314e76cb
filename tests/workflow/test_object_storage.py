"""Recordings and results in an object store: the same bytes as on a disk, whole after a kill, and no credentials anywhere."""

import shutil
from pathlib import Path

import pytest
import yaml

from cluster import object_store
from running import copy_project, snakemake

ANSWERS = "answers.csv"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    missing = object_store.what_is_missing()
    if missing:
        pytest.skip(missing)
    with object_store.serving(tmp_path_factory.mktemp("s3") / "server") as running:
        yield running


def project_with_answers_at(place: str, folder: Path) -> Path:
    """Copy of the project with a study of the survey alone, whose answers are there."""
    study = {
        "study": "stored",
        "data": "recordings",
        "data_root": place,
        "data_source": {"name": "answers", "licence": "none", "obtain": "made by the test"},
        "chapters": ["survey"],
        "survey": {"file": ANSWERS},
    }
    copy_project(folder)
    (folder / "study.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
    return folder


def test_a_study_in_a_store_killed_in_mid_upload_ends_with_the_bytes_of_a_disk(store, project, tmp_path):
    answers = project / "resources" / "survey" / "survey_reconstructed.csv"
    call = ["--cores", "1", "table_3_2", "--configfile", "study.yaml"]
    (tmp_path / "recordings").mkdir()
    shutil.copy(answers, tmp_path / "recordings" / ANSWERS)
    on_disk = project_with_answers_at(str(tmp_path / "recordings"), tmp_path / "on_disk")
    snakemake(on_disk, *call).whole()

    store.bucket.upload_file(str(answers), f"recordings/{ANSWERS}")
    stored = project_with_answers_at(f"s3://{object_store.BUCKET}/recordings", tmp_path / "stored")
    object_store.run_and_kill(stored, store, "survey_paired.html", [*call, *object_store.STORED])
    partial = object_store.results_in_store(store)
    assert "stored/tables/table_3_2.csv" in partial
    assert "stored/tables/survey_paired.html" not in partial, "half an object is none"

    assert snakemake(stored, "--unlock", *call, *object_store.STORED, env=store.environment).status == 0
    run = snakemake(stored, *call, *object_store.STORED, env=store.environment).whole()
    assert run.jobs == {"survey_tables": 1, "table_3_2": 1}, "what was done stays"
    assert object_store.results_in_store(store) == object_store.results_on_disk(on_disk)
    assert not (stored / "results").exists()
    assert object_store.betrayed(tmp_path, store) == []
    assert not store.betrays(run.text.encode())
