"""Files are written whole or not at all, and JSON is strict."""

import math
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from lumbar.base.errors import NumericalError, user_message
from lumbar.base.files import leftover_temp_files, read_json, replacing, write_csv, write_json, write_text
from refusing import refusal


def test_failed_write_keeps_old_file(tmp_path):
    path = tmp_path / "result.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half of the new")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_full_disk_error_names_file_and_free_space(tmp_path):
    """Writing to /dev/full fails in the kernel as on a full disk, with an error that names no file."""
    path = tmp_path / "result.txt"
    write_text(path, "old")
    with pytest.raises(OSError, match="No space left") as caught, replacing(path) as temporary:
        temporary.symlink_to("/dev/full")
        temporary.write_text("new")
    assert caught.value.filename == str(path)
    named, folder = re.escape(str(path)), re.escape(str(tmp_path))
    assert re.match(rf"{named}: No space left on device.*\d+\.\d MB .*{folder}", user_message(caught.value))
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_are_made_and_line_ends_kept(tmp_path):
    path = tmp_path / "a" / "b" / "text.txt"
    write_text(path, "θ\nω\n")
    assert path.read_bytes() == "θ\nω\n".encode()


def test_json_takes_numpy_values_and_returns_them(tmp_path):
    path = tmp_path / "values.json"
    value = {"a": np.float64(0.1), "b": np.arange(3), 3: [np.int32(1), None, True], "c": np.eye(2)}
    write_json(path, value)
    expected = {"a": 0.1, "b": [0, 1, 2], "3": [1, None, True], "c": [[1.0, 0.0], [0.0, 1.0]]}
    assert read_json(path) == expected


@pytest.mark.parametrize("bad", [math.nan, math.inf, np.float64("nan"), np.array([1.0, -np.inf])])
def test_numbers_that_are_not_finite_are_never_written(tmp_path, bad):
    path = tmp_path / "values.json"
    with pytest.raises(NumericalError, match=r"values\.json\.outer\[1\]"):
        write_json(path, {"outer": [1.0, bad]})
    assert not path.exists()


def test_broken_json_names_file_and_line(tmp_path):
    path = tmp_path / "broken.json"
    path.write_text('{\n "a": 1,\n "b": }\n')
    assert "broken.json, line 3" in refusal(read_json, path)
    path.write_text('{"a": NaN}')
    assert "NaN" in refusal(read_json, path)
    path.write_bytes(b"\xff\xfe{")
    assert "UTF-8" in refusal(read_json, path)
    assert "absent.json" in refusal(read_json, tmp_path / "absent.json")


def test_csv_keeps_full_precision(tmp_path):
    path = tmp_path / "frame.csv"
    values = [0.1 + 0.2, 1e-300, -1 / 3]
    write_csv(path, pd.DataFrame({"x": values}))
    assert b"\r" not in path.read_bytes()
    assert pd.read_csv(path, float_precision="round_trip")["x"].tolist() == values


def test_leftovers_of_killed_process_are_listed(tmp_path):
    lines = (
        "import os, sys",
        "from lumbar.base.files import replacing",
        "with replacing(sys.argv[1]) as half:",
    )
    code = "\n".join([*lines, "    half.write_text('half')", "    os.kill(os.getpid(), 9)"])
    killed = subprocess.run([sys.executable, "-c", code, tmp_path / "table.csv"], check=False)
    assert killed.returncode == -9
    write_text(tmp_path / "table.tex", "whole")
    (tmp_path / ".table.tex").mkdir()
    ((name, left),) = leftover_temp_files(tmp_path)
    assert name == "table.csv"
    assert (left / "table.csv").read_text() == "half"
    assert leftover_temp_files(tmp_path / "absent") == []


def test_errors_about_other_files_keep_their_names(tmp_path):
    with pytest.raises(FileNotFoundError) as caught, replacing(tmp_path / "result.txt"):
        (tmp_path / "absent.csv").read_text()
    assert caught.value.filename == str(tmp_path / "absent.csv")
