"""What users get wrong: one message that names the place, a status other than 0, nothing half-written."""

import numpy as np
import pytest
import yaml

from refusing import has_tokens
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
    names = {file: file.split(".")[0] for file in records}
    tissue = {
        "records": [{"name": names[file], "file": file} for file in names],
        "training": [*names.values()],
    }
    study = {"study": name, "data": "recordings", "data_root": f"data/{name}", "chapters": ["tissue"]}
    study |= {"data_source": {"name": "a test", "licence": "none", "obtain": "the test itself"}}
    study |= {"tissue": tissue, **changes}
    path = folder / "config" / "studies" / f"{name}.yaml"
    path.write_text(yaml.safe_dump(study), encoding="utf-8")
    return str(path.relative_to(folder))


def recording(samples=2000, seed=1):
    random = np.random.default_rng(seed)
    position = np.cumsum(random.standard_normal(samples)) * 0.05
    force = 0.8 * position + 0.05 * random.standard_normal(samples)
    rows = enumerate(zip(position, force, strict=True))
    return [f"{0.01 * index:.2f},{x:.5f},{y:.5f}" for index, (x, y) in rows]


def text(rows):
    return "\n".join(["time_s,position_mm,force_N", *rows]) + "\n"


def nothing_written(folder, name):
    files = [path for path in (folder / "results" / name).rglob("*") if path.is_file()]
    return {path.parent.name for path in files} <= {"logs", "benchmarks"}


def test_wrong_keys_are_all_named(folder):
    config = lab(folder, "wrong_keys", {"a.csv": text(recording())}, sede=1, seed=-3, chapters=["tissu"])
    run = snakemake(folder, "--cores", "1", "--configfile", config)
    assert run.status != 0
    for tokens in (
        f"{config}, line 10: seed: …-3…≥ 0",
        f"{config}, line 9: sede: …'seed'",
        "chapters.0: …\"tissu\"…'tissue'…surgeon, ",
    ):
        assert has_tokens(run.text, tokens)
    assert "Traceback" not in run.text and "common.smk" not in run.text
    assert nothing_written(folder, "wrong_keys")


FAULTS = {
    "study: twice\n": "lines 6 and {0}: …'study'",
    "survey: [\n": "config/config.yaml, line {1}: …YAML: ",
}


@pytest.mark.parametrize("added", FAULTS)
def test_faults_of_the_default_files_are_named(folder, added):
    path = folder / "config" / "config.yaml"
    before = path.read_text(encoding="utf-8")
    path.write_text(before + added, encoding="utf-8")
    try:
        run = snakemake(folder, "--cores", "1", "--dry-run")
    finally:
        path.write_text(before, encoding="utf-8")
    line = len(before.splitlines()) + 1
    assert run.status != 0 and "Traceback" not in run.text
    assert has_tokens(run.text, FAULTS[added].format(line, line + 1))


def clip_at_median(rows):
    """Clip the force: half of it then lies at one value."""
    cells = [row.rsplit(",", 1) for row in rows]
    limit = float(np.median([float(force) for _, force in cells]))
    return [f"{rest},{min(float(force), limit):.5f}" for rest, force in cells]


def changed(line, row):
    rows = recording()
    return text([*rows[:line], row, *rows[line + 1 :]])


def test_invalid_records_end_the_run_with_all_faults(folder):
    """One start of Snakemake reports all files; the tests of each reader check the faults of one file."""
    invalid = {
        "number": (changed(9, "0.09,abc,0.1"), ("line 11", "'abc'")),
        "uneven": (text(recording()[:100] + recording()[140:]), ("0.41 s", "0.01 s")),
        "clipped": (text(clip_at_median(recording())), ("output: clipped",)),
        "column": (text(recording()).replace("force_N", "Kraft"), ("force_N", "Kraft", "position_mm")),
    }
    files = {f"{name}.csv": content for name, (content, _) in invalid.items()}
    config = lab(folder, "invalid", {**files, "sound.csv": text(recording(seed=3))})
    refused = snakemake(folder, "--cores", "1", "--configfile", config)
    assert refused.status != 0
    assert f"{len(invalid)} problems" in refused.text
    assert "/sound.csv: " not in refused.text
    assert nothing_written(folder, "invalid")
    for name, (_, words) in invalid.items():
        said = refused.text.split(f"/{name}.csv: ")[1].split("  - /")[0]
        for word in words:
            assert word in said, f"{word!r} not in:\n{said[:3000]}"
