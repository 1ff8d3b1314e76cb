"""The archive of a run: what it says of its files is true, the same run gives the same bytes, and the profile is met."""

import hashlib
import json
import os
import runpy
import subprocess
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lumbar.publishing.run_crate import METADATA, Run, end_of_run, write_crate

HELLO = hashlib.sha256(b"Hello World!").hexdigest()
TABLE = "results/lab/tables/table_3_1.csv"
SOURCE = {"name": "Laboratory X", "licence": "CC BY 4.0", "obtain": "ask"}


@pytest.fixture
def written(tmp_path):
    """Writes the archive of a small run; returns its path."""
    files = {
        **{
            name: name.encode()
            for name in ("Snakefile", "README.md", "LICENSE", "envs/lock.txt", "workflow/a.py")
        },
        "resources/thesis/table_4_1.csv": b"a\n1\n",
        "results/lab/run_config.yaml": b"study: lab\n",
        TABLE: b"model,vaf\nKB,80\nHO,82\n",
    }
    paths = {name: tmp_path / "files" / name for name in files}
    for name, path in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(files[name])
    results = {name: path for name, path in paths.items() if name.startswith("results/")}
    run = Run(
        study="lab",
        title="A study",
        data="Laboratory X",
        ended=end_of_run(results, "1700000000"),
        outputs={TABLE: "Table 3.1"},
        configuration="results/lab/run_config.yaml",
        versions={"python": "3.12.1", "lumbar": "0.1.0", "numpy": "2.4.6", "fmpy": None},
        environment={"OMP_NUM_THREADS": "1"},
        recordings=((HELLO, "hello.csv"),),
        source=SOURCE,
    )

    def write(name):
        project = {name: path for name, path in paths.items() if name not in results}
        write_crate(tmp_path / name, run, results, project)
        return tmp_path / name

    return write


def records_of(archive: Path) -> dict[str, dict]:
    with zipfile.ZipFile(archive) as crate:
        return {item["@id"]: item for item in json.loads(crate.read(METADATA))["@graph"]}


def test_every_file_described_is_there_with_its_checksum_and_linked_from_the_root(written):
    archive = written("run.zip")
    records = records_of(archive)
    with zipfile.ZipFile(archive) as crate:
        described = {key: item for key, item in records.items() if "contentSize" in item}
        for key, item in described.items():
            content = crate.read(key)
            assert (item["sha256"], item["contentSize"]) == (
                hashlib.sha256(content).hexdigest(),
                str(len(content)),
            )
    parts = {part["@id"] for part in records["./"]["hasPart"]}
    assert described.keys() | {"envs/", "workflow/"} <= parts <= records.keys()
    assert [item["@id"] for item in records["#run"]["result"]] == [TABLE]
    assert records[TABLE]["name"] == "Table 3.1"
    assert records["./"]["datePublished"] == "2023-11-14T22:13:20+00:00"


def test_a_recording_outside_the_archive_is_named_by_its_content(written):
    records = records_of(written("run.zip"))
    # The example of RFC 6920, section 8.1.
    named = records["ni:///sha-256;f4OxZX_x_FO5LcGBSKHWXfwtSx-j1ncoSt3SABJtkGk"]
    assert (named["name"], named["license"]) == ("hello.csv", "CC BY 4.0")
    assert {"@id": named["@id"]} in records["#run"]["object"]


def test_the_same_run_gives_the_same_bytes(written):
    assert written("first.zip").read_bytes() == written("second.zip").read_bytes()


def test_without_a_declared_time_a_run_ended_with_its_last_result(tmp_path):
    times = {"a": 1_600_000_000, "b": 1_500_000_000}
    for name, seconds in times.items():
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (seconds, seconds))
    found = end_of_run({name: tmp_path / name for name in times}, None)
    assert found == datetime(2020, 9, 13, 12, 26, 40, tzinfo=UTC)


def test_a_run_is_compared_with_an_archive(written, project, tmp_path, capsys):
    check = runpy.run_path(str(project / "tests" / "reference" / "check_results.py"))
    archive, results = written("run.zip"), tmp_path / "files" / "results" / "lab"
    call = ["--crate", str(archive), "--results", str(results)]
    assert check["main"](call) == 0
    assert "1 of 1 outputs are the bytes of run.zip" in capsys.readouterr().out
    table = {"tables/table_3_1.csv": {"keys": ["model"], "absolute": {"default": 0.5}}}
    (results / "tables" / "table_3_1.csv").write_text("model,vaf\nKB,80.3\nHO,83\n")
    assert check["compare_with_crate"](archive, results, table) == 1
    told = capsys.readouterr().out
    assert "NOT ALLOWED: tables/table_3_1.csv [HO] vaf: 82.0 -> 83.0" in told
    assert "\nallowed: tables/table_3_1.csv [KB] vaf: 80.0 -> 80.3 (moved by +0.3, tol" in f"\n{told}"
    (results / "tables" / "table_3_1.csv").unlink()
    assert check["compare_with_crate"](archive, results, table) == 1


def test_an_independent_checker_finds_the_profile_met(written, project):
    folder = os.environ.get("LUMBAR_CRATE_VALIDATOR")
    if folder is None:
        pytest.skip(
            "rocrate-validator is not installed: tests/get_crate_validator.sh, LUMBAR_CRATE_VALIDATOR"
        )
    command = [Path(folder) / "bin" / "python", project / "tests" / "crate" / "validate_crate.py"]

    def check(archive):
        return subprocess.run([*command, archive], capture_output=True, text=True, check=False)

    done = check(written("run.zip"))
    assert done.returncode == 0, done.stdout + done.stderr
    # That it would have found something:
    with (
        zipfile.ZipFile(written("run.zip")) as crate,
        zipfile.ZipFile(written("run.zip").parent / "less.zip", "w") as less,
    ):
        for name in crate.namelist():
            if name != TABLE:
                less.writestr(name, crate.read(name))
    assert (
        f"REQUIRED: ro-crate-1.1_12.1: The RO-Crate does not include the Data Entity '{TABLE}'"
        in check(less.filename).stdout
    )
