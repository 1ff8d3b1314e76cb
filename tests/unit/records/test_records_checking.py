"""Recordings that are short, slow, clipped or awkward: checked, all problems of all files told, limits named."""

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from foreign_files import FORCE, rows
from periodic_records import noise, record, relaxing_force

import lumbar
from column_files import write_columns
from lumbar.base.errors import InputError
from lumbar.interface.reading import read_listed
from lumbar.records.checking import check_recordings
from lumbar.records.unpacking import read_readable
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings
from lumbar.study.load_study import load_study
from lumbar.study.study import reading_plan
from refusing import has_tokens, refusal

LAYOUT = {
    "columns": {
        "time": {"column": "time_s", "unit": "s"},
        "output": {"column": "force_N", "quantity": "force", "unit": "N"},
    }
}


def planned(path, **changes) -> dict:
    entry = {"chapter": "tissue", "set": "tissue", "reader": "columns", "path": str(path), "layout": LAYOUT}
    return entry | {"name": path.stem} | changes


def written(tmp_path, name):
    time = np.arange(200) / 100
    write_columns(tmp_path / name, "%.6f", time_s=time, force_N=np.sin(time))
    return tmp_path / name


def test_problems_of_all_files_are_listed(tmp_path):
    good, broken, short = (written(tmp_path, f"{name}.csv") for name in ("good", "broken", "short"))
    broken.write_text(broken.read_text().replace("0.030000", "abc"))
    short.write_text("time_s,force_N\n0,1\n")
    plan = [planned(good), planned(broken), planned(short), planned(tmp_path / "absent.csv")]
    message = refusal(check_recordings, plan)
    assert message.startswith("recordings: 3 problems")
    for tokens in ("broken.csv", "line 5: time … 'abc'", "short.csv … 1 samples", "absent.csv … file"):
        assert has_tokens(message, tokens), tokens


def test_units_agree_within_a_set_only(tmp_path):
    a, b = written(tmp_path, "a.csv"), written(tmp_path, "b.csv")
    kilonewtons = {"output": {"column": "force_N", "quantity": "force", "unit": "kN"}}
    other = {"columns": LAYOUT["columns"] | kilonewtons}
    plan = [planned(a), planned(b, layout=other)]
    assert has_tokens(refusal(check_recordings, plan), "b … force … kN … N … a")
    described = check_recordings([planned(a), planned(b, layout=other, chapter="surgeon", set="surgeon")])
    assert sorted(described) == ["surgeon", "tissue"]


def test_impossible_rate_is_reported(tmp_path):
    message = refusal(check_recordings, [planned(written(tmp_path, "a.csv"), rate_Hz=0.01)])
    assert has_tokens(message, "a.csv … 100 Hz … 0.01 Hz … ratio")


ONE_EFFECT = StudySettings(improvement=ImprovementSettings(most_effects=1))


def diagnosed(position, force):
    found = lumbar.diagnose([record(position, force)], settings=ONE_EFFECT)
    assert str(found.add().locate()) and str(found.add().compare())
    return found


def test_input_up_to_nyquist_is_diagnosed():
    position = noise(2000, 3)
    assert diagnosed(position, relaxing_force(position) + 0.05 * noise(2000, 4))


def test_sixty_samples_at_ten_hertz_are_located():
    position = np.cumsum(noise(60, 5))
    test = record(position, relaxing_force(position) + 0.01 * noise(60, 6))
    slow = lumbar.diagnose([resample_clock(test, 0.1)], settings=ONE_EFFECT)
    assert str(slow.add().locate())


@pytest.mark.parametrize("step", [0.1, 0.01])
def test_fifty_samples_are_too_few_at_any_rate(step):
    position = np.cumsum(noise(50, 5))
    with pytest.raises(InputError, match=r"\b50 samples\b.*\b48\b"):
        lumbar.diagnose([resample_clock(record(position, relaxing_force(position)), step)])


def resample_clock(test, step):
    return replace(test, time=np.arange(len(test)) * step)


ROWS = [f"{n / 100:.2f},{n % 7},{n % 5}" for n in range(200)]


def write(tmp_path, cell=None, name="record.csv"):
    rows = list(ROWS)
    if cell is not None:
        rows[50] = f"0.50,1,{cell}"
    path = tmp_path / name
    content = ("time_s,position_mm,force_N\n" + "\n".join(rows) + "\n").encode()
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    return path


@pytest.mark.parametrize(
    ("cell", "tokens"),
    [
        ("1_000", "line 52: output … '1_000'"),
        ("\u0661\u0662", "line 52: output … '\u0661\u0662'"),  # Arabic digits, which Python's float reads
        ("1e11", "line 52: output … 100000000000.0 … 1e+06 N"),
        ("-2e6", "line 52: output … -2000000.0 … 1e+06 N"),
        ("9" * 400, "line 52: output … inf"),
        ("\0", "line 52: output … '\\x00'"),
        ('"' + "x" * 200_000, "line 52:"),
        ("x" * 2_000_000, "line 52 … 1000000"),
    ],
)
@pytest.mark.parametrize("name", ["record.csv", "record.csv.gz"])
def test_implausible_cells_are_rejected(tmp_path, cell, tokens, name):
    path = write(tmp_path, cell, name)
    message = refusal(lumbar.read, path)
    assert has_tokens(message, tokens) and str(path) in message
    assert len(message) < 1000


@pytest.mark.parametrize(
    "change",
    [
        lambda packed: packed[:-20],
        lambda packed: packed[:30] + b"\xff" * 20 + packed[50:],
        lambda packed: b"\x1f\x8b" + b"\0" * 30,
    ],
)
def test_broken_packed_files_are_rejected(tmp_path, change):
    path = write(tmp_path, name="record.csv.gz")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=r"record\.csv\.gz\b.*(cut|broken)"):
        lumbar.read(path)


def test_parts_of_packed_file_are_joined(tmp_path):
    path = tmp_path / "two.gz"
    path.write_bytes(gzip.compress(b"a" * 3_000_000) + gzip.compress(b"b") + b"\0" * 10)
    assert read_readable(path, Path.read_bytes) == b"a" * 3_000_000 + b"b"


def test_study_trims_record(tmp_path, project):
    """``trim_s`` of a record reaches both the check of the recordings and their reading."""
    (tmp_path / "labview.csv").write_text("time_s,position_mm,force_N\n" + rows(","))
    lumbar.import_recordings(tmp_path / "labview.csv").save(tmp_path / "records")
    path = tmp_path / "records" / "study.yaml"
    content = yaml.safe_load(path.read_text())
    content["tissue"]["records"][0]["trim_s"] = [0.5, 2]
    study = load_study(content, project)
    [described] = check_recordings(reading_plan(study, ["tissue"]))["tissue"]
    assert (described["samples"], described["duration_s"]) == (300, 1.5)
    tissue = study.settings.tissue
    [record] = read_listed([path.parent / "labview.csv"], tissue.records, tissue.layout)
    np.testing.assert_allclose(record["output"], FORCE[100:400], atol=2e-5)
    content["tissue"]["records"][0]["trim_s"] = [2, 0.5]
    assert has_tokens(refusal(load_study, content, project), "tissue.records.0.trim_s: … 2 … 0.5")
