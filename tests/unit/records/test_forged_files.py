"""Untrusted files that read other files or exhaust the machine are rejected with a message."""

import os
import re
import time

import numpy as np
import pandas as pd
import pytest
from forged_files import read_forged, row, workbook, write_forged

import lumbar
from lumbar.base.errors import InputError
from lumbar.base.files import MAX_FILE_BYTES
from lumbar.interface.result import read_table
from lumbar.records.child_process import SECONDS
from lumbar.records.markers import read_markers
from refusing import has_tokens, refusal

h5py = pytest.importorskip("h5py")


def test_workbook_without_dimension_is_read(tmp_path):
    rows = (row(n, "ABC", n / 100, n % 7, n % 5) for n in range(1, 200))
    (tmp_path / "sound.xlsx").write_bytes(workbook("".join(rows)))
    [read] = lumbar.import_recordings(
        tmp_path / "sound.xlsx",
        time=1,
        time_unit="s",
        position=2,
        position_unit="mm",
        force=3,
        force_unit="N",
    )
    assert len(read.record) == 199


_READERS = {
    "a.csv": lumbar.read,
    "a.mat": lumbar.read,
    "a.csv.gz": lumbar.read,
    "a.xlsx": lambda path: lumbar.import_recordings([path]),
    "a.h5": lambda path: lumbar.import_recordings([path]),
    "a.c3d": read_markers,
    "a.c3d.gz": read_markers,
    "a.trc": read_markers,
    "a.bvh": read_markers,
    "sheet.csv": lambda path: lumbar.read(path, "survey"),
    "models.json": lumbar.load_models,
    "settings.yaml": lumbar.load_settings,
}


@pytest.mark.parametrize("name", _READERS)
def test_pipes_devices_and_folders_are_rejected(tmp_path, name):
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(InputError, match=rf"{re.escape(name)}: .*\b(pipe|device)\b"):
        _READERS[name](path)
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=rf"{re.escape(name)}: .*\b(pipe|device)\b"):
        _READERS[name](path)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match=rf"{re.escape(name)}: .*\b(folder|recordings)\b"):
        _READERS[name](path)


@pytest.mark.parametrize("name", _READERS)
def test_every_kind_of_file_has_one_limit_of_size(tmp_path, name):
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(MAX_FILE_BYTES + 1)  # of holes, which take no room
    with pytest.raises(InputError, match=rf"{re.escape(name)}: .*\b200 MB.*\b2?\d+ MB"):
        _READERS[name](path)


TOKENS = {
    **dict.fromkeys(("external.h5", "virtual.h5", "pipe.h5", "external.mat"), "position_mm … file"),
    "linked.h5": "x … file",
    **dict.fromkeys(("many_sets.h5", "shape.mat", "bomb.csv.gz"), "200 MB"),
    "cells.mat": "20000 variables",
    "far.xlsx": "25000000 cells",
    "order_models.json": "1 … 33 … number",
    "deep_models.json": "nested",
    "lists_models.json": "1000000 lists",
    "merged.yaml": "aliases",
    "tags.yaml": "line 2 … tag",
}
"""Tokens in the messages of some files."""


def became_of(folder, drawn_too):
    """Why forged files are refused; the others are read, and nothing is run or left behind."""
    refused = {}
    for path in write_forged(folder, drawn_too, seed=27):
        began = time.process_time()
        refused[path.name] = read_forged(path)
        assert time.process_time() - began < SECONDS, path
    assert sorted(path.name for path in folder.iterdir()) == ["canary", "files", "pipe"]  # no marker
    for name, tokens in TOKENS.items():
        assert name in refused[name] and has_tokens(refused[name], tokens), refused[name]
    return [words for words in refused.values() if words]


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
def test_forged_and_randomly_changed_files_do_no_harm(tmp_path):
    refused = became_of(tmp_path, 250)
    assert 40 < len(refused) < 290  # of 300 files


def test_huge_header_is_rejected(tmp_path):
    path = tmp_path / "sheet.csv"
    path.write_text("a," * 450_000 + "\n" + "1," * 450_000 + "\n")
    with pytest.raises(InputError, match=r"sheet\.csv, header: .*'a'"):
        lumbar.read(path, "survey")


def test_many_columns_are_read_line_by_line(tmp_path, monkeypatch):
    """A short text is read in this process: of many columns, line by line."""
    path = tmp_path / "wide.csv"
    for header in (",".join(f"c{n}" for n in range(100_000)), "time_s,position_mm,force_N"):
        path.write_text(header + "\n" + ("1," * 99_999 + "1\n") * 3)
        monkeypatch.setattr(np, "loadtxt", None)
        with pytest.raises(InputError, match=r"wide\.csv: \d"):
            lumbar.read(path)


def test_tables_that_lumbar_wrote_are_read_back(tmp_path):
    frame = pd.DataFrame(
        {"lift": ["a", "b"], "mass_kg": [1.5, np.nan], "frame": [1, 2], "safe": [True, False]}
    )
    path = tmp_path / "body.csv"
    frame.to_csv(path, index=False)
    pd.testing.assert_frame_equal(read_table(path, "a lift"), frame)
    path.unlink()
    os.mkfifo(path)
    assert has_tokens(refusal(read_table, path, "a lift"), "body.csv … pipe")
