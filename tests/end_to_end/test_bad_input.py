"""What users get wrong: one message that names the place, a status other than 0, nothing half-written."""

import numpy as np
import pytest
import yaml

from running import copy_project, snakemake


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return copy_project(tmp_path_factory.mktemp("bad"))


def lab(folder, name, records, **changes):
    """Write a study of tissue recordings and its data folder; return the configuration file."""
    data = folder / "data" / name
    data.mkdir(parents=True)
    for file, text in records.items():
        (data / file).write_text(text, encoding="utf-8")
    study = {
        "study": name,
        "data": "recordings",
        "data_root": f"data/{name}",
        "data_source": {"name": "a test", "licence": "none", "obtain": "the test itself"},
        "chapters": ["tissue"],
        "tissue": {
            "records": [{"name": file.split(".")[0], "file": file} for file in records],
            "training": [file.split(".")[0] for file in records],
        },
    }
    study.update(changes)
    path = folder / "config" / "studies" / f"{name}.yaml"
    path.write_text(yaml.safe_dump(study), encoding="utf-8")
    return str(path.relative_to(folder))


def recording(samples=2000, seed=1):
    random = np.random.default_rng(seed)
    position = np.cumsum(random.standard_normal(samples)) * 0.05
    force = 0.8 * position + 0.05 * random.standard_normal(samples)
    return [
        f"{0.01 * index:.2f},{x:.5f},{y:.5f}"
        for index, (x, y) in enumerate(zip(position, force, strict=True))
    ]


def text(rows):
    return "\n".join(["time_s,position_mm,force_N", *rows]) + "\n"


def nothing_written(folder, name):
    made = folder / "results" / name
    return not [
        path for path in made.rglob("*") if path.is_file() and path.parent.name not in ("logs", "benchmarks")
    ]


def test_wrong_keys_are_all_named(folder):
    config = lab(folder, "wrong_keys", {"a.csv": text(recording())}, sede=1, seed=-3, chapters=["tissu"])
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    for word in (
        f"  - {config}, line 10: seed: found -3; allowed: whole number ≥ 0",
        f"  - {config}, line 9: sede: unknown key; did you mean 'seed'?",
        'chapters.0: found "tissu"; allowed: surgeon, ',
    ):
        assert word in run.text
    assert "Traceback" not in run.text and "common.smk" not in run.text
    assert "common.smk" not in run.text
    assert nothing_written(folder, "wrong_keys")


@pytest.mark.parametrize(
    ("added", "words"),
    [
        ("study: twice\n", "lines 6 and {added}: key 'study' stands twice"),
        ("survey: [\n", "config/config.yaml, line {after}: not valid YAML: while parsing a flow node"),
        ("title: Pr\xfcfung\n", "config/config.yaml, line {added}: byte 0xfc is not UTF-8"),
    ],
)
def test_faults_of_the_default_files_are_named(folder, added, words):
    path = folder / "config" / "config.yaml"
    before = path.read_bytes()
    path.write_bytes(before + added.encode("latin-1"))
    try:
        run = snakemake(folder, "--cores", "1", "--dry-run")
    finally:
        path.write_bytes(before)
    assert run.status != 0 and "Traceback" not in run.text
    line = len(before.splitlines()) + 1
    assert words.format(added=line, after=line + 1) in run.text


def test_missing_file_names_source_and_licence(folder):
    config = lab(folder, "missing", {"a.csv": text(recording())})
    (folder / "data" / "missing" / "a.csv").unlink()
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    for word in ("a.csv", "a test", "licence: none", "the test itself"):
        assert word in run.text
    assert nothing_written(folder, "missing")


def test_path_out_of_the_data_root_is_refused(folder):
    records = [{"name": "a", "file": "../outside.csv"}]
    config = lab(
        folder, "outside", {"a.csv": text(recording())}, tissue={"records": records, "training": ["a"]}
    )
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    assert "../outside.csv" in run.text
    assert "relative to data_root" in run.text


def changed(change):
    """Write a recording some of whose lines are changed."""
    rows = recording()
    return text(change(rows) or rows)


def replaced(line, *rows):
    """Change rows in place from one data line on."""
    return lambda whole: whole.__setitem__(slice(line, line + len(rows)), rows)


def swap(rows):
    rows[3], rows[4] = rows[4], rows[3]


def clip_at_median(rows):
    """Clip the force: half of it then lies at one value."""
    cells = [row.rsplit(",", 1) for row in rows]
    limit = float(np.median([float(force) for _, force in cells]))
    rows[:] = [f"{rest},{min(float(force), limit):.5f}" for rest, force in cells]


UNSOUND = {
    "number": (changed(replaced(9, "0.09,abc,0.1")), ("line 11", "'abc'")),
    "cells": (changed(replaced(29, "0.29,0.1")), ("line 31",)),
    "nan": (changed(replaced(5, "0.05,nan,0.1")), ("line 7", "nan")),
    "unsorted": (changed(swap), ("time must increase",)),
    "uneven": (changed(lambda rows: rows[:100] + rows[140:]), ("sampled evenly",)),
    "short": (changed(lambda rows: rows[:4]), ("samples",)),
    "empty": (text([]), ("no data rows",)),
    "clipped": (changed(clip_at_median), ("output: clipped",)),
    "column": (text(recording()).replace("force_N", "Kraft"), ("force_N", "Kraft", "position_mm")),
    "constant": (text(f"{0.01 * index:.2f},1.0,{index % 7}" for index in range(500)), ("constant",)),
}
"""Recordings of which each alone is refused, and what is said of it."""


@pytest.fixture(scope="module")
def refused(folder):
    """What is said of a study of all unsound recordings and a sound one: one start of Snakemake tells it all."""
    files = {f"{name}.csv": content for name, (content, _) in UNSOUND.items()}
    config = lab(folder, "unsound", {**files, "sound.csv": text(recording(seed=3))})
    return snakemake(folder, "--cores", "1", "--configfile", config)


def test_unsound_records_are_refused_before_anything_runs(folder, refused):
    assert refused.status != 0
    assert f"{len(UNSOUND)} problems" in refused.text
    assert "/sound.csv: " not in refused.text
    assert nothing_written(folder, "unsound")


@pytest.mark.parametrize("name", UNSOUND)
def test_each_unsound_record_is_named_with_what_is_wrong(refused, name):
    place = f"/{name}.csv: "
    said = refused.text[refused.text.index(place) :].removeprefix(place).split("  - /")[0]
    for word in UNSOUND[name][1]:
        assert word in said, f"{word!r} not in:\n{said[:3000]}"


def test_unreadable_wrong_subject_is_refused(folder):
    path = folder / "config" / "subjects" / "giant.yaml"
    path.write_text(
        "subject: {name: giant, sex: male, mass_kg: 8000, height_m: 18, experience: expert, trials: []}\n",
        encoding="utf-8",
    )
    run = snakemake(folder, "--cores", "1", "stability", "--configfile", "config/subjects/giant.yaml")
    assert run.status != 0
    assert "subject.mass_kg" in run.text
    assert "subject.height_m" in run.text
