"""``lumbar compare, locate, diagnose, refine --base pendulum`` on folders of angle and moment."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from pendulum_experiments import make_pendulum_experiment


def write(folder, records, decimals=5):
    folder.mkdir(exist_ok=True)
    for name, columns in records.items():
        table = np.column_stack(list(columns.values()))
        header = ",".join(columns)
        np.savetxt(folder / f"{name}.csv", table, f"%.{decimals}f", ",", header=header, comments="")
    return folder


@pytest.fixture(scope="module")
def friction(tmp_path_factory):
    """Write angle and moment alone, with five decimals."""
    return write(
        tmp_path_factory.mktemp("friction"), make_pendulum_experiment("coulomb_friction", 11, 10.0).records
    )


def test_angle_and_moment_are_enough(run, friction, tmp_path):
    status, out, err = run("diagnose", friction, "--base", "pendulum", "--output", tmp_path)
    assert status == 0, err
    assert "The pendulum model is missing coulomb friction" in out
    assert "Not tried: hand load as measured, for want of box_held in the records." in out
    found = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert (found["base"], found["unit"]) == ("pendulum", "N m")
    assert (found["verdict"], found["selected"]) == ("named", ["coulomb_friction"])
    assert found["ranking"][0]["parameters"]["coulomb_moment"]["unit"] == "N m"
    assert {item["effect"] for item in found["not_tried"]} == {
        "hand_load",
        "variable_length",
        "moving_pivot",
    }
    page = (tmp_path / "diagnosis.html").read_text(encoding="utf-8")
    assert "Not tried: variable length as measured, for want of length_m" in page


def test_gravity_of_the_settings_reaches_the_effects(run, tmp_path):
    folder = write(tmp_path / "load", make_pendulum_experiment("hand_load", 2, 16.0).records)
    (tmp_path / "mars.yaml").write_text("stability: {pendulum: {gravity_m_s2: 3.71}}", encoding="utf-8")
    common = (folder, "--base", "pendulum", "--add", "hand_load", "--output", tmp_path)
    added = []
    for settings in ((), ("--config", tmp_path / "mars.yaml")):
        status, _, err = run("refine", *common, *settings)
        assert status == 0, err
        model = json.loads((tmp_path / "refined.json").read_text(encoding="utf-8"))["models"][-1]
        added.append(model["structure"]["effects"][0].get("constants"))
    assert added == [None, {"g": 3.71}]


def test_compare_locate_and_refine(run, friction, tmp_path):
    folder = tmp_path / "two"
    folder.mkdir()
    for name in ("sway.csv", "swings.csv"):
        shutil.copy(friction / name, folder)
    common = (folder, "--base", "pendulum", "--output", tmp_path)
    status, out, err = run("compare", *common)
    assert status == 0, err
    assert "N m" in out
    status, out, err = run("locate", *common)
    assert status == 0, err
    assert "Around reversals" in out
    status, out, err = run("refine", *common, "--add", "coulomb_friction", "--data", "a bench")
    assert status == 0, err
    written = json.loads((tmp_path / "refined.json").read_text(encoding="utf-8"))
    assert written["data"] == "a bench"
    base, model = written["models"]
    assert model["name"] == "pendulum+coulomb_friction"
    assert model["scores"]["train_rms"] < 0.3 * base["scores"]["train_rms"]
    status, _, err = run("refine", *common, "--add", "backlash")
    assert status == 1
    assert "unknown effect backlash; known are hand_load, passive_stiffness" in err


def test_further_columns_are_used_where_they_are(run, tmp_path):
    records = make_pendulum_experiment("variable_length", 3, 8.0).records
    for columns in records.values():
        columns["box_held"] = np.zeros_like(columns["time_s"])
    folder = write(tmp_path / "records", records, decimals=6)
    status, out, err = run("diagnose", folder, "--base", "pendulum", "--output", tmp_path / "out")
    assert status == 0, err
    assert "missing variable length" in out
    assert "for want of length_m" not in out
    assert "for want of box_held" not in out
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["ranking"][0]["forms"][0].startswith("measured_")
    assert found["ranking"][0]["parameters"]["moving_mass"]["unit"] == "kg"


def test_wrong_records_are_told_and_nothing_is_written(run, friction, tmp_path):
    text = (friction / "sway.csv").read_text(encoding="utf-8")
    for change, words in (
        (lambda: text.replace("angle_rad", "angle_deg"), "no column 'angle_rad'"),
        (lambda: text.replace("moment_Nm", "moment_Nm,length_m", 1), "3 cells; 4 are expected"),
    ):
        folder = tmp_path / "broken"
        folder.mkdir(exist_ok=True)
        (folder / "sway.csv").write_text(change(), encoding="utf-8")
        status, out, err = run("diagnose", folder, "--base", "pendulum", "--output", tmp_path / "out")
        assert (status, out) == (1, "")
        assert words in err
        assert not (tmp_path / "out").exists()


def test_a_column_in_one_record_only_is_told(run, friction, tmp_path):
    for path in friction.iterdir():
        (tmp_path / path.name).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    lines = (tmp_path / "swings.csv").read_text(encoding="utf-8").splitlines()
    lines = [f"{lines[0]},box_held", *(f"{line},1" for line in lines[1:])]
    (tmp_path / "swings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    status, _, err = run("diagnose", tmp_path, "--base", "pendulum", "--output", tmp_path / "out")
    assert status == 1
    assert "box_held is share of the box held in 1" in err
    assert "all records of a set need the same channels" in err
