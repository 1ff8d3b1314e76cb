"""Signals that are neither position nor force keep their names, from the file to the verdict."""

import numpy as np
import pytest

import lumbar

READ = {"position_unit": "V", "force_unit": "V", "time": "none", "rate": 10.0}


@pytest.fixture
def tank(tmp_path):
    pump = np.random.default_rng(0).standard_normal((400, 1)).cumsum(axis=0) / 5
    level = 0.5 * pump + 0.01 * np.random.default_rng(1).standard_normal(pump.shape)
    path = tmp_path / "tank.csv"
    np.savetxt(path, np.hstack([pump, level]), delimiter=",", header="pump,level", comments="", fmt="%.5f")
    return path


def test_a_level_in_volts_is_no_position(tank, tmp_path):
    imported = lumbar.import_recordings(tank, position="pump", force="level", **READ)
    imported.save(tmp_path / "out")
    assert (tmp_path / "out/tank.csv").read_text().startswith("time_s,pump_V,level_V\n")
    (record,) = imported.records
    assert [channel.label for channel in record.channels.values()] == ["Pump (V)", "Level (V)"]
    settings = lumbar.load_settings(tmp_path / "out/study.yaml")
    (read,) = lumbar.read(tmp_path / "out/tank.csv", layout=settings.tissue.layout)
    assert [channel.quantity for channel in read.channels.values()] == ["pump", "level"]


def test_the_load_of_a_driven_test_comes_first_whatever_it_is_called(tank, tmp_path):
    lumbar.import_recordings(tank, position="level", force="pump", **READ).save(
        tmp_path / "out", forward=True
    )
    assert (tmp_path / "out/tank.csv").read_text().startswith("time_s,pump_V,level_V\n")


def test_names_of_position_and_force_stay(tmp_path):
    path = tmp_path / "cell.csv"
    rows = [(0.01 * n, n % 7, n % 5) for n in range(200)]
    np.savetxt(path, rows, delimiter=",", header="Time (s),Displacement,Load cell", comments="", fmt="%.5f")
    found = lumbar.import_recordings(path, position_unit="V", force_unit="V")
    assert list(found[0].names.values()) == ["time_s", "position_V", "force_V"]
