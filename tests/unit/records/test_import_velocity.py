"""Columns that are no position: a velocity is integrated and that is said; other readings keep their names to the verdict."""

import json

import numpy as np
import pytest
from foreign_files import RATE, TIME, rows

import lumbar
from lumbar.base.errors import InputError

RADIAN = 2 * np.pi * 1.1
VELOCITY = 4 * RADIAN * np.cos(RADIAN * TIME)
"""Millimetres per second, of 4 mm · sin."""
MOTION = 4 * np.sin(RADIAN * TIME)
FORCE = 1.3 * MOTION + 0.02 * np.random.default_rng(5).normal(size=len(TIME))


def imported(tmp_path, head, columns=(TIME, VELOCITY, FORCE), **told):
    (tmp_path / "trial.csv").write_text(head + "\n" + rows(",", columns=columns, digits=7), encoding="utf-8")
    [recording] = lumbar.import_recordings(tmp_path / "trial.csv", **told)
    return recording


@pytest.mark.parametrize(
    ("head", "told"),
    [
        ("time_s,v [mm/s],force_N", {}),
        ("time_s,speed mm/s,force_N", {}),
        ("time_s,speed/mm/s,force_N", {}),
        ("time_s,speed_mm_s,force_N", {}),
        ("time_s,speed_mm_per_s,force_N", {}),
        ("time_s,Geschwindigkeit,force_N", {"position_unit": "mm/s"}),
        ("time_s,drive [V],force_N", {"position": "drive", "position_unit": "1 mm/s"}),
    ],
)
def test_a_velocity_is_integrated_and_it_is_said(tmp_path, head, told):
    one = imported(tmp_path, head, **told)
    step = 1 / RATE
    assert one.record["input"][0] == 0
    assert one.record["input"] == pytest.approx(MOTION, abs=step**2 / 12 * np.ptp(RADIAN * VELOCITY) + 1e-6)
    assert list(one.frame()) == ["time_s", "position_mm", "force_N"]
    [note] = [note for note in one.notes if "integral" in note]
    for words in ("0 at the first sample", "is not known", "an offset of the velocity would be a drift"):
        assert words in note


def test_what_is_kept_says_so_too(run, tmp_path):
    imported(tmp_path, "time_s,v [mm/s],force_N")
    out = run.done("import", tmp_path / "trial.csv", "--output", tmp_path / "records")
    [entry] = json.loads((tmp_path / "records/imported.json").read_text())["records"]
    for text in (out, (tmp_path / "records/study.yaml").read_text(), entry["notes"][0]):
        assert "is the integral of column 2 'v' [mm/s]" in text


def test_a_position_goes_before_a_velocity(tmp_path):
    one = imported(tmp_path, "time_s,v [mm/s],z [mm],force_N", columns=(TIME, VELOCITY, MOTION + 3, FORCE))
    assert one.record["input"] == pytest.approx(MOTION + 3, abs=1e-6)
    both = {"position": "v"}
    two = imported(
        tmp_path, "time_s,v [mm/s],z [mm],force_N", columns=(TIME, VELOCITY, MOTION + 3, FORCE), **both
    )
    assert two.record["input"][0] == 0


def test_two_velocities_and_a_velocity_without_unit_are_asked_about(tmp_path):
    with pytest.raises(InputError, match=r"position may be column 2 'v1' .* or column 3 'v2' .*; choose by"):
        imported(tmp_path, "time_s,v1 [mm/s],v2 [mm/s],force_N", columns=(TIME, VELOCITY, VELOCITY, FORCE))
    with pytest.raises(InputError, match=r"without a unit; give --position-unit, e.g. mm/s"):
        imported(tmp_path, "time_s,velocity,force_N")
    note = imported(tmp_path, "time_s,velocity,force_N", position="velocity", position_unit="mm").notes[0]
    assert "is named a velocity, and is taken for a position as told" in note


def test_parts_of_a_recording_share_their_zero(tmp_path):
    """As long as nothing is missing before them; else each has its own, and says so."""
    whole = imported(tmp_path, "time_s,v [mm/s],force_N").record
    part = imported(tmp_path, "time_s,v [mm/s],force_N", trim=(1, 2)).record
    assert part["input"] == pytest.approx(whole["input"][200:400])
    gap = VELOCITY.copy()
    gap[50] = np.nan
    part = imported(tmp_path, "time_s,v [mm/s],force_N", columns=(TIME, gap, FORCE), trim=(1, 2))
    assert part.record["input"] == pytest.approx(whole["input"][200:400] - whole["input"][51])
    assert "0 at line 53" in part.notes[1]


def test_an_uneven_clock_is_integrated_on_itself(tmp_path):
    time = TIME + np.random.default_rng(2).uniform(-0.4, 0.4, len(TIME)) / RATE
    speed = 4 * RADIAN * np.cos(RADIAN * time)
    record = imported(tmp_path, "time_s,v [mm/s],force_N", columns=(time, speed, FORCE)).record
    expected = 4 * (np.sin(RADIAN * record.time) - np.sin(RADIAN * time[0]))
    assert record["input"] == pytest.approx(expected, abs=0.02)


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
