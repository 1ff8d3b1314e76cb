"""One recording written in two dozen dialects is read back as the same record."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, RATE, TIME, foreign_files

import lumbar

FILES = foreign_files()


@pytest.mark.parametrize("name", FILES)
def test_a_dialect_is_read(tmp_path, name):
    content, told = FILES[name]
    (tmp_path / name).write_bytes(content)
    [imported] = lumbar.import_recordings(tmp_path / name, **told)
    record = imported.record
    assert 1 / record.sampling_time == pytest.approx(RATE)
    assert record.time - record.time[0] == pytest.approx(TIME, abs=1e-9)
    assert record["input"] == pytest.approx(POSITION, abs=2e-5)
    assert record["output"] == pytest.approx(FORCE, abs=2e-5)
    assert list(imported.frame()) == ["time_s", "position_mm", "force_N"]
    assert not imported.notes


def test_packed_files_are_unpacked(tmp_path):
    (tmp_path / "trial 1.lvm.gz").write_bytes(gzip.compress(FILES["labview.lvm"][0]))
    [imported] = lumbar.import_recordings(tmp_path / "trial 1.lvm.gz")
    assert imported.record.name == "trial_1"
    np.testing.assert_allclose(imported.record["input"], POSITION, atol=2e-5)
