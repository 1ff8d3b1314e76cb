"""What users get wrong: one message that names the place, a status other than 0, nothing half-written."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from running import copy_project, snakemake

pytestmark = pytest.mark.end_to_end


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


def clip_at_median(rows):
    """Clip the force: half of it then lies at one value."""
    cells = [row.rsplit(",", 1) for row in rows]
    limit = float(np.median([float(force) for _, force in cells]))
    rows[:] = [f"{rest},{min(float(force), limit):.5f}" for rest, force in cells]


def text(rows):
    return "\n".join(["time_s,position_mm,force_N", *rows]) + "\n"


def fails(folder, config, *words):
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    for word in words:
        assert word in run.text, f"{word!r} not in:\n{run.text[-3000:]}"
    return run


def nothing_written(folder, name):
    made = folder / "results" / name
    return not [
        path for path in made.rglob("*") if path.is_file() and path.parent.name not in ("logs", "benchmarks")
    ]


def test_wrong_keys_are_all_named(folder):
    config = lab(folder, "wrong_keys", {"a.csv": text(recording())}, sede=1, seed=-3, chapters=["tissu"])
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    for word in ("sede", "seed", "-3", "tissu"):
        assert word in run.text
    assert "Traceback" not in run.text
    assert "common.smk" not in run.text
    assert nothing_written(folder, "wrong_keys")


def test_missing_file_names_source_and_licence(folder):
    config = lab(folder, "missing", {"a.csv": text(recording())})
    (folder / "data" / "missing" / "a.csv").unlink()
    fails(folder, config, "a.csv", "a test", "licence: none", "the test itself")
    assert nothing_written(folder, "missing")


def test_path_out_of_the_data_root_is_refused(folder):
    records = [{"name": "a", "file": "../outside.csv"}]
    config = lab(
        folder, "outside", {"a.csv": text(recording())}, tissue={"records": records, "training": ["a"]}
    )
    fails(folder, config, "../outside.csv", "relative to data_root")


def test_all_bad_cells_of_all_files_are_named_with_their_lines(folder):
    first, second = recording(), recording(seed=2)
    first[9] = "0.09,abc,0.1"
    first[19] = "0.19,nan,0.1"
    second[29] = "0.29,0.1"
    config = lab(folder, "bad_cells", {"first.csv": text(first), "second.csv": text(second)})
    run = fails(folder, config, "first.csv", "line 11", "'abc'", "second.csv", "line 31")
    # One line beside the message, and no list of a rule's files: a person reads this.
    assert run.text.count("FAILED: ") == 1
    assert "logs/check_all_recordings.log" in run.text
    assert "CalledProcessError" not in run.text
    assert max(map(len, run.text.splitlines())) < 300
    assert nothing_written(folder, "bad_cells")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("nan", lambda rows: rows.__setitem__(5, "0.05,nan,0.1"), ("line 7", "nan")),
        ("unsorted", lambda rows: rows.__setitem__(slice(3, 5), [rows[4], rows[3]]), ("time must increase",)),
        ("uneven", lambda rows: rows.__delitem__(slice(100, 140)), ("sampled evenly",)),
        ("enormous", lambda rows: rows.__setitem__(5, "0.05,1e308,0.1"), ("line 7", "1e+308")),
        ("short", lambda rows: rows.__delitem__(slice(4, None)), ("samples",)),
        ("empty", lambda rows: rows.clear(), ("no data rows",)),
        ("clipped", clip_at_median, ("output: clipped",)),
    ],
)
def test_unsound_record_is_refused_before_anything_runs(folder, name, change, words):
    rows = recording()
    change(rows)
    config = lab(folder, f"record_{name}", {"a.csv": text(rows), "b.csv": text(recording(seed=3))})
    fails(folder, config, "a.csv", *words)
    assert nothing_written(folder, f"record_{name}")


def test_missing_column_lists_the_header(folder):
    rows = text(recording()).replace("force_N", "Kraft")
    config = lab(folder, "column", {"a.csv": rows})
    fails(folder, config, "force_N", "Kraft", "position_mm")


def test_constant_input_is_refused(folder):
    rows = [f"{0.01 * index:.2f},1.0,{index % 7}" for index in range(500)]
    config = lab(folder, "constant", {"a.csv": text(rows)})
    fails(folder, config, "constant")


def test_unreadable_wrong_subject_is_refused(folder):
    path = folder / "config" / "subjects" / "giant.yaml"
    path.write_text(
        "subject: {name: giant, sex: male, mass_kg: 8000, height_m: 1.8, experience: expert, trials: []}\n",
        encoding="utf-8",
    )
    run = snakemake(folder, "--cores", "1", "stability", "--configfile", "config/subjects/giant.yaml")
    assert run.status != 0
    assert "subject.mass_kg" in run.text
    assert "subject.trials" in run.text
