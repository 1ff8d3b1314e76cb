"""Detection lines from the designed signal to the verdict: even and odd nonlinearity told apart on the project's own multisine.

The signal is designed and written by ``lumbar signals``, answered by a tissue simulated here, recorded as a file and
given to ``lumbar locate``.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from lumbar import cli
from lumbar.tissue.diagnosis.residuals.time_frequency import (
    EVEN,
    EXCITED,
    ODD,
    excited_lines,
    line_classes,
)

PERIODS = 6
SIGMA = 0.02

FORCES = {
    "even": lambda z: 0.02 * z**2,
    "odd": lambda z: 0.01 * z**3,
    "none": lambda z: 0.0 * z,
}


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """Folder with an odd multisine of six periods and its description."""
    folder = tmp_path_factory.mktemp("signals")
    study = folder / "study.yaml"
    multisine = {"grid": "odd", "detection_group": 4, "periods": PERIODS}
    study.write_text(yaml.safe_dump({"signals": {"multisine": multisine}}))
    assert cli.main(["signals", "--band", "5", "--config", str(study), "--output", str(folder)]) == 0
    return folder


def located(designed, kind: str, tmp_path, capsys) -> dict[str, dict]:
    """Rows of ``location.csv`` of the multisine by view."""
    position = np.loadtxt(designed / "multisine.csv", delimiter=",", skiprows=1)
    time, z = position[:, 0], position[:, 1]
    force = lfilter([1.5, -1.3], [1.0, -0.85], z) + FORCES[kind](z)
    force += SIGMA * np.random.default_rng(4).standard_normal(len(z))
    records = tmp_path / "records"
    records.mkdir()
    np.savetxt(
        records / "multisine.csv",
        np.column_stack([time, z, force]),
        "%.6f",
        ",",
        header="time_s,position_mm,force_N",
        comments="",
    )
    capsys.readouterr()
    assert cli.main(["locate", str(records), "--output", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "location.csv").open(encoding="utf-8") as stream:
        return {row["view"]: row for row in csv.DictReader(stream)}


def test_the_lines_are_classed_as_designed(designed):
    description = json.loads((designed / "multisine.json").read_text(encoding="utf-8"))
    lines, left_out = np.array(description["lines"]), description["detection_lines"]
    position = np.loadtxt(designed / "multisine.csv", delimiter=",", skiprows=1)[:, 1]
    period = position.reshape(PERIODS, -1)[-1]
    found = excited_lines(period)
    assert found.tolist() == lines.tolist()
    assert np.all(lines % 2 == 1)
    classes = line_classes(found, len(period) // 2)
    assert set(classes[left_out["odd"]]) == {ODD} and len(left_out["odd"]) > 2
    assert set(classes[left_out["even"]]) == {EVEN}
    assert set(classes[lines]) == {EXCITED}


@pytest.mark.parametrize("kind", FORCES)
def test_even_and_odd_nonlinearity_are_told_apart(designed, kind, tmp_path, capsys):
    rows = located(designed, kind, tmp_path, capsys)
    sentence = rows["frequency"]["finding"]
    even, odd = "(even nonlinearity" in sentence, "(odd nonlinearity" in sentence
    assert (even, odd) == (kind == "even", kind == "odd"), sentence
    if kind == "none":
        assert "no line stands out of the noise" in sentence
    else:
        assert "an odd grid with detection lines would" not in sentence
