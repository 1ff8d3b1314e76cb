"""Comparison of two runs' outputs, and the star of runs of `make test-portable`."""

import io
import json
import zipfile

import pytest

from portable import environments, outputs, runs


def archive(text: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(zipfile.ZipInfo("model.json"), text)
    return stream.getvalue()


CSV = b"name,rms,count\na,1000.0,3\nb,0.001,4\n"


def test_digits_are_counted_against_the_largest_of_a_kind():
    digits = outputs.digits
    assert digits(CSV, CSV, ".csv") == outputs.SAME_BYTES
    assert digits(CSV, CSV.replace(b"0.001", b"0.002"), ".csv") == pytest.approx(6)
    one, other = ({"path": [0.0, x], "large": 1e9} for x in (2.0, 2.0002))
    assert digits(json.dumps(one).encode(), json.dumps(other).encode(), ".json") == pytest.approx(4, abs=0.01)
    assert digits(b"<p>x = 100.0</p>", b"<p>x = 100.1</p>", ".svg") == pytest.approx(3, abs=0.01)
    assert digits(archive(b'{"a": 100}'), archive(b'{"a": 101}'), ".fmu") == pytest.approx(2, abs=0.01)


@pytest.mark.parametrize(
    ("one", "other", "suffix"),
    [
        (CSV, CSV.replace(b"b,", b"c,"), ".csv"),
        (CSV, CSV.replace(b"0.001", b""), ".csv"),
        (b'{"verdict": "named", "x": 1}', b'{"verdict": "tied", "x": 1}', ".json"),
        (b'{"x": [1, 2]}', b'{"x": [1]}', ".json"),
        (b"\xff\xfe\x00", b"\xff\xfe\x01", ".pdf"),
    ],
)
def test_more_than_numbers_is_no_agreement(one, other, suffix):
    assert outputs.digits(one, other, suffix) == outputs.DIFFERENT


def test_a_file_of_one_run_alone_is_no_agreement(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name / "logs").mkdir(parents=True)
        (tmp_path / name / "t.csv").write_bytes(CSV)
        (tmp_path / name / "logs" / "t.log").write_text(name)
    (tmp_path / "one" / "more.csv").write_bytes(CSV)
    found = outputs.compare_folders(tmp_path / "one", tmp_path / "other")
    assert found == {"t.csv": outputs.SAME_BYTES, "more.csv": outputs.DIFFERENT}


def test_a_kernel_that_the_processor_cannot_execute_is_left_out_with_a_sentence(monkeypatch):
    monkeypatch.setattr(runs.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(runs, "processor_flags", lambda: {"pni", "avx2", "fma"})
    obstacles = {run.name: run.obstacle for run in runs.star([])}
    assert obstacles["Haswell"] == obstacles["Prescott"] == ""
    assert obstacles["SkylakeX"].startswith("this processor cannot execute it: it has no avx512bw, avx512cd")
    monkeypatch.setattr(runs.platform, "machine", lambda: "aarch64")
    assert "kind aarch64" in {run.name: run.obstacle for run in runs.star([])}["Haswell"]


def test_the_lowest_dependencies_are_the_bounds_of_the_package_description():
    lowest = environments.requirements("lowest")
    newest = environments.requirements("newest")
    bounds = [requirement.split(">=") for requirement in newest if ">=" in requirement]
    assert len(bounds) > 10
    assert {"==".join(bound) for bound in bounds} <= set(lowest)
    assert not any(">=" in requirement for requirement in lowest)
