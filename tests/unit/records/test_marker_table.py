"""Markers in CSV files."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

MILLIMETRES = MarkerLayout(unit="mm")
POINTS = np.random.default_rng(2).normal(0, 400, (30, 2, 3)).round(3)
TIME = 2 + np.arange(30) / 60
ONE = "time_s,C7_x,C7_y,C7_z,L ASI_x,L ASI_y,L ASI_z"
TWO = ",C7,,,L ASI,,\ntime_s,X,Y,Z,X,Y,Z"


def table(header=ONE, separator=",", time=TIME, digits=4, decimal=".", extra=""):
    def text(value, places):
        return f"{value:.{places}f}".replace(".", decimal)

    lines = header.replace(",", separator).split("\n")
    for frame, row in enumerate(POINTS.reshape(30, -1)):
        cells = [] if time is None else [text(time[frame], digits)]
        lines.append(separator.join([*cells, *(text(value, 3) for value in row)]) + extra)
    return "\n".join(lines) + "\n"


def write(tmp_path, text, name="lift.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        table(),
        table(TWO),
        table(TWO.replace(",,,", ",C7,C7,").replace(",,", ",L ASI,L ASI")),
        table(separator=";", decimal=","),
        table(separator="\t"),
        table(digits=2),
        table(ONE.replace("time_s", "Time (ms)"), time=1e3 * TIME),
        table("time_s," + ONE.removeprefix("time_s,").replace("_", ".")),
        table(ONE + ",sync", extra=",1"),
        "\ufeff" + table().replace("\n", "\r\n") + "\r\n",
    ],
)
def test_layouts_read_alike(tmp_path, text):
    recording = read_markers(write(tmp_path, text), MILLIMETRES)
    assert list(recording.positions) == ["C7", "L ASI"]
    assert recording.rate == 60
    np.testing.assert_allclose(recording.time, TIME, atol=0.005)
    for number, marker in enumerate(recording.positions):
        np.testing.assert_allclose(recording[marker], POINTS[:, number] / 1e3, atol=1e-9)


@pytest.mark.parametrize("name", ["C7_x_mm", "C7 X [mm]", "C7.x (mm)"])
def test_unit_behind_the_axis(tmp_path, name):
    header = "time_s," + ",".join(
        name.replace("C7", marker).replace(" X", f" {axis.upper()}").replace("x", axis)
        for marker in ("C7", "THIGH")
        for axis in "xyz"
    )
    recording = read_markers(write(tmp_path, table(header)))
    np.testing.assert_allclose(recording["THIGH"], POINTS[:, 1] / 1e3, atol=1e-9)
    with pytest.raises(InputError, match=r"states 'mm' but markers\.unit is 'm'"):
        read_markers(write(tmp_path, table(header)), MarkerLayout(unit="m"))


def test_rate_of_a_file_without_times(tmp_path):
    path = write(tmp_path, table(ONE.removeprefix("time_s,"), time=None))
    with pytest.raises(InputError, match="no column of times"):
        read_markers(path, MILLIMETRES)
    recording = read_markers(path, MarkerLayout(unit="mm", rate_Hz=50))
    np.testing.assert_allclose(recording.time, np.arange(30) / 50)


def test_missing_samples_and_other_columns(tmp_path):
    lines = table(ONE + ",sync", extra=",1").splitlines()
    cells = lines[5].split(",")
    lines[5] = ",".join([cells[0], "", "", "", *cells[4:]])
    lines[6] = ",".join([lines[6].split(",")[0], "0", "0", "0", *lines[6].split(",")[4:]])
    recording = read_markers(write(tmp_path, "\n".join(lines)), MILLIMETRES)
    assert np.flatnonzero(np.isnan(recording["C7"]).all(axis=1)).tolist() == [4, 5]
    assert recording.notes == ("columns that are no coordinates were left out: sync",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table(ONE.replace("C7_z", "C7_y")), "C7_y: stands twice"),
        (table(ONE.replace("C7_z", "height")), "C7: has the columns x, y; x, y and z are needed"),
        ("time_s,angle_rad\n0,1\n1,2\n", "no column of a marker among time_s, angle_rad"),
        ("time_s,C7_x,C7_y,C7_z\n0,1,2,3\n", "2 lines; a line of names and two frames are needed"),
        ("", "neither tab, semicolon nor comma"),
        (table().replace(f"{TIME[4]:.4f},", ""), "line 6: 6 cells; 7 are needed"),
        (table().replace(f"{TIME[4]:.4f},", "1_000,"), "line 6: could not convert string to float: '1_000'"),
        (table().replace(f"{TIME[4]:.4f},", "1e200,"), "line 6: a number too large"),
        (table().replace(f"{TIME[4]:.4f},", ","), "frame 5 has no time"),
        (table(time=np.delete(2 + np.arange(31) / 60, 14)), "the clock is not even, or frames are missing"),
        (table(time=0 * TIME), "it must increase"),
        (table(ONE.replace("C7_x", "C7_x_mm")), "units , mm in the header"),
        (table().replace("C7_x", '"' + "C" * 200_000 + '_x"'), "not a table"),
        (table(), "the file states no unit; set markers.unit"),
    ],
)
def test_tables_that_are_refused(tmp_path, text, said):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_markers(path, MarkerLayout() if "no unit" in said else MILLIMETRES)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_declared_rate_that_the_times_contradict(tmp_path):
    with pytest.raises(InputError, match=r"its times run at 60 Hz, but markers\.rate_Hz is 100"):
        read_markers(write(tmp_path, table()), MarkerLayout(unit="mm", rate_Hz=100))
