"""Markers in CSV and BVH files."""

import gzip
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import lumbar
from refusing import has_tokens, refusal


def read_markers(path, layout):
    return lumbar.read(path, "markers", layout=layout)


MILLIMETRES = lumbar.MarkerLayout(unit="mm")
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
def test_layouts_of_tables_have_equal_values(tmp_path, text):
    recording = read_markers(write(tmp_path, text), MILLIMETRES)
    assert list(recording.positions) == ["C7", "L ASI"]
    assert recording.rate == 60
    np.testing.assert_allclose(recording.time, TIME, atol=0.005)
    for number, marker in enumerate(recording.positions):
        np.testing.assert_allclose(recording[marker], POINTS[:, number] / 1e3, atol=1e-9)


@pytest.mark.parametrize("name", ["C7_x_mm", "C7 X [mm]", "C7.x (mm)"])
def test_unit_after_axis_is_read(tmp_path, name):
    header = "time_s," + ",".join(
        name.replace("C7", marker).replace(" X", f" {axis.upper()}").replace("x", axis)
        for marker in ("C7", "THIGH")
        for axis in "xyz"
    )
    recording = read_markers(write(tmp_path, table(header)), lumbar.MarkerLayout())
    np.testing.assert_allclose(recording["THIGH"], POINTS[:, 1] / 1e3, atol=1e-9)
    message = refusal(read_markers, write(tmp_path, table(header)), lumbar.MarkerLayout(unit="m"))
    assert has_tokens(message, "'mm' … markers.unit … 'm'")


def test_file_without_times_needs_rate(tmp_path):
    path = write(tmp_path, table(ONE.removeprefix("time_s,"), time=None))
    assert has_tokens(
        refusal(read_markers, path, MILLIMETRES), "lift.csv … column … time_s … markers.rate_Hz"
    )
    recording = read_markers(path, lumbar.MarkerLayout(unit="mm", rate_Hz=50))
    np.testing.assert_allclose(recording.time, np.arange(30) / 50)


def test_missing_samples_and_other_columns(tmp_path):
    lines = table(ONE + ",sync", extra=",1").splitlines()
    cells = lines[5].split(",")
    lines[5] = ",".join([cells[0], "", "", "", *cells[4:]])
    lines[6] = ",".join([lines[6].split(",")[0], "0", "0", "0", *lines[6].split(",")[4:]])
    recording = read_markers(write(tmp_path, "\n".join(lines)), MILLIMETRES)
    assert np.flatnonzero(np.isnan(recording["C7"]).all(axis=1)).tolist() == [4, 5]
    assert [has_tokens(note, "sync") for note in recording.notes] == [True]


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        (table(ONE.replace("C7_z", "C7_y")), "C7_y:"),
        ("time_s,angle_rad\n0,1\n1,2\n", "marker … time_s, angle_rad"),
        ("time_s,C7_x,C7_y,C7_z\n0,1,2,3\n", "2 lines … frames"),
        ("", "tab, semicolon … comma"),
        (table().replace(f"{TIME[4]:.4f},", ""), "line 6: 6 cells … 7"),
        (table().replace(f"{TIME[4]:.4f},", "1_000,"), "line 6: column 1 … '1_000'"),
        (table().replace(f"{TIME[4]:.4f},", "1e200,"), "line 6: 1e+200 … column 1"),
        (table().replace(f"{TIME[4]:.4f},", ","), "frame 5 … time"),
        (table(time=np.delete(2 + np.arange(31) / 60, 14)), "frame 15 … 2.25 s … 58 Hz … frames"),
        (table(time=0 * TIME), "time … 0 … 0 s … increase"),
        (table(ONE.replace("C7_x", "C7_x_mm")), "units … mm … header"),
        (table().replace("C7_x", '"' + "C" * 200_000 + '_x"'), "C7: … y, z … x"),
    ],
)
def test_incomplete_or_contradictory_tables_are_rejected(tmp_path, text, tokens):
    path = write(tmp_path, text)
    message = refusal(read_markers, path, MILLIMETRES)
    assert has_tokens(message, tokens) and str(path) in message


def test_declared_rate_that_contradicts_times_is_rejected(tmp_path):
    layout = lumbar.MarkerLayout(unit="mm", rate_Hz=100)
    message = refusal(read_markers, write(tmp_path, table()), layout)
    assert has_tokens(message, "lift.csv … 60 Hz … markers.rate_Hz … 100")


LAYOUT = lumbar.MarkerLayout(check_axes=False)


@pytest.fixture(scope="module")
def gait(shared):
    return shared / "real" / "lifting" / "qualisys_ior_gait" / "Qualisys.c3d"


def packed(source, target):
    target.write_bytes(gzip.compress(source.read_bytes()))
    return target


def test_packed_markers_are_unchanged(tmp_path, shared, gait):
    stands_up = shared / "real" / "lifting" / "sts_trunk_flexion_trc" / "sts_unperturbed_1.trc"
    for source in (gait, stands_up):
        plain = read_markers(source, LAYOUT)
        found = read_markers(packed(source, tmp_path / f"{source.name}.GZ"), LAYOUT)
        assert found.name == source.stem and found.source.endswith(".GZ")
        for name, points in plain.positions.items():
            np.testing.assert_array_equal(found[name], points)


def test_broken_and_huge_packed_markers_are_rejected(tmp_path, gait):
    shutil.copy(gait, tmp_path / "cut.c3d")
    (tmp_path / "cut.c3d").write_bytes(gait.read_bytes()[:-5000])
    with pytest.raises(lumbar.InputError, match=r"^\S+cut\.c3d\.gz: .*\d+ frames.*\bcut\b"):
        read_markers(packed(tmp_path / "cut.c3d", tmp_path / "cut.c3d.gz"), LAYOUT)
    (tmp_path / "short.trc.gz").write_bytes(gzip.compress(b"PathFileType" * 999)[:-30])
    assert has_tokens(refusal(read_markers, tmp_path / "short.trc.gz", LAYOUT), "short.trc.gz … cut")
    (tmp_path / "bomb.c3d.gz").write_bytes(gzip.compress(bytes(210_000_000), 1))
    message = refusal(read_markers, tmp_path / "bomb.c3d.gz", LAYOUT)
    assert has_tokens(message, "bomb.c3d.gz … 200 MB") or has_tokens(message, "bomb.c3d.gz … memory")


CENTIMETRES = lumbar.MarkerLayout(unit="cm", up="+y", forward="+z")
BVH = Path(__file__).with_name("walk.bvh").read_text(encoding="utf-8")
ANGLES = np.random.default_rng(6).uniform(-180, 180, (20, 9))
ROOT = np.random.default_rng(7).uniform(-100, 100, (20, 3))


def rows(values):
    return "".join(" ".join(f"{value:.6f}" for value in row) + "\n" for row in values)


def turn(axis, degrees):
    """Rotation matrix about one axis, written out."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = cos
    matrix[second, first], matrix[first, second] = sin, -sin
    return matrix


def expected():
    """Positions in centimetres by the definition: offsets in the parent's axes, rotations in the order of the channels."""
    found = []
    for root, angles in zip(ROOT, ANGLES, strict=True):
        hips = turn("Z", angles[0]) @ turn("X", angles[1]) @ turn("Y", angles[2])
        chest = hips @ turn("Z", angles[3]) @ turn("X", angles[4]) @ turn("Y", angles[5])
        arm = chest @ turn("X", angles[6]) @ turn("Y", angles[7]) @ turn("Z", angles[8])
        at_chest = root + hips @ [0, 40, 0]
        at_arm = at_chest + chest @ [20, 0, 0]
        found.append([root, at_chest, at_arm, at_arm + arm @ [30, 0, 0]])
    return np.array(found)


@pytest.mark.parametrize("name", ["nexus.csv", "motive.csv", "qualisys.tsv", "qualisys_numbered.tsv"])
def test_vendor_exports_are_recognised(tmp_path, name):
    """Made to their published layouts; devices before the markers and bones beside them are left out."""
    text = (path := Path(__file__).parent / "exports" / name).read_text()
    recording = read_markers(path, lumbar.MarkerLayout(check_axes=False))
    assert (list(recording.positions), recording.rate) == (["C7", "SACR"], pytest.approx(100))
    np.testing.assert_allclose(recording["C7"], np.arange(5)[:, None] * [1e-3, 1e-3, 2e-3] + [0, 0.01, 1.4])
    assert np.flatnonzero(np.isnan(recording["SACR"][:, 0])).tolist() == [3]
    less = text.splitlines(keepends=True)
    for broken in (text[: len(text) // 3], text[:-10], "".join((*less[:-4], *less[-2:]))):
        with pytest.raises(
            lumbar.InputError, match=rf"(?s){re.escape(name)}.*(\bexport\b|\bcells\b|\bclock\b)"
        ):
            read_markers(write(tmp_path, broken, name), lumbar.MarkerLayout(check_axes=False))


@pytest.mark.parametrize("section", ["Model Outputs", "Joints", "Segments"])
def test_trajectories_of_nexus_follow_other_sections(tmp_path, section):
    text = (Path(__file__).parent / "exports" / "nexus.csv").read_text()
    trajectories = text[text.index("Trajectories") :]
    other = f"{section}\n100\n,,Anna:Value,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n\n"
    layout = lumbar.MarkerLayout(check_axes=False)
    recording = read_markers(write(tmp_path, other + trajectories, "export.csv"), layout)
    assert list(recording.positions) == ["C7", "SACR"]
    assert has_tokens(
        refusal(read_markers, write(tmp_path, other, "export.csv"), layout), "export.csv … Trajectories"
    )


def test_joints_of_a_chain(tmp_path):
    recording = read_markers(write(tmp_path, BVH + rows(np.hstack([ROOT, ANGLES])), "walk.bvh"), CENTIMETRES)
    assert list(recording.positions) == ["Hips", "Chest", "Arm", "Arm_end"]
    assert recording.rate == pytest.approx(100)
    # x lateral (right) is -x of a person who faces z with y up.
    standard = expected()[..., [0, 2, 1]] * [-1, 1, 1] / 100
    for number, name in enumerate(recording.positions):
        np.testing.assert_allclose(recording[name], standard[:, number], atol=1e-7)


def test_joints_without_length_are_noted(tmp_path):
    text = BVH.replace("OFFSET 20 0 0", "OFFSET 0 0 0") + rows(np.hstack([ROOT, ANGLES]))
    recording = read_markers(write(tmp_path, text, "walk.bvh"), CENTIMETRES)
    assert has_tokens(" ".join(recording.notes), "Arm (Chest)")


@pytest.mark.parametrize("around", [0.0, 1.0])
def test_joints_may_have_position_channels(tmp_path, around):
    """Some suits give every joint six channels, whose positions are zero or the offset once more."""
    text = BVH.replace("CHANNELS 3 Zrotation", "CHANNELS 6 Xposition Yposition Zposition Zrotation")
    offset = np.tile([0, 40 * around, 0], (20, 1))
    values = np.hstack([ROOT, ANGLES[:, :3], offset, ANGLES[:, 3:]])
    recording = read_markers(write(tmp_path, text + rows(values), "walk.bvh"), CENTIMETRES)
    standard = expected()[..., [0, 2, 1]] * [-1, 1, 1] / 100
    np.testing.assert_allclose(recording["Arm_end"], standard[:, 3], atol=1e-7)


@pytest.mark.parametrize(
    ("change", "tokens"),
    [
        (lambda text: text.replace("MOTION", "MOTIONS"), "BVH"),
        (lambda text: text.replace("Frame Time: 0.01", "Frame Time: 0"), "Frame Time … 0 s"),
        (lambda text: text.replace("Frame Time:", "Time:"), "line 23: 'Time: 0.01' … 'Frame Time:'"),
        (lambda text: text.replace("}\n}\nMOTION", "}\nMOTION"), "1 joints"),
        (lambda text: text.replace("JOINT Chest", "ROOT Chest"), "line 6: 'ROOT Chest' … ROOT"),
        (lambda text: text.replace("OFFSET 0 40 0", "OFFSET 0 40"), "line 8: 2 cells … 3"),
        (lambda text: text.replace("CHANNELS 3 X", "CHANNELS 4 X"), "line 13: 'CHANNELS 4 Xrotation"),
        (lambda text: text.replace("CHANNELS 3 X", "CHANNELS 3 W"), "line 13: 'CHANNELS 3 Wrotation"),
        (lambda text: text.replace("OFFSET 30", "LENGTH 30"), "line 16: 'LENGTH 30 0 0' … ROOT, JOINT"),
        (lambda text: text[: text.rindex(" ")] + "\n", "line 43: 11 cells … 12"),
        (lambda text: text[: text.rindex(" ")] + " 1_0\n", "line 43: column 12 … '1_0'"),
        (lambda text: text[: text.rindex(" ")] + " inf\n", "line 43: inf … column 12"),
    ],
)
def test_invalid_bvh_files_are_rejected(tmp_path, change, tokens):
    path = write(tmp_path, change(BVH + rows(np.hstack([ROOT, ANGLES]))), "walk.bvh")
    message = refusal(read_markers, path, CENTIMETRES)
    assert has_tokens(message, tokens) and str(path) in message
