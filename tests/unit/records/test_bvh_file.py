"""BVH: closed forms of a chain of joints, and files that are refused."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

CENTIMETRES = MarkerLayout(unit="cm", up="+y", forward="+z")
BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0 40 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Arm
    {
      OFFSET 20 0 0
      CHANNELS 3 Xrotation Yrotation Zrotation
      End Site
      {
        OFFSET 30 0 0
      }
    }
  }
}
MOTION
Frames: 20
Frame Time: 0.01
"""
ANGLES = np.random.default_rng(6).uniform(-180, 180, (20, 9))
ROOT = np.random.default_rng(7).uniform(-100, 100, (20, 3))


def rows(values):
    return "".join(" ".join(f"{value:.6f}" for value in row) + "\n" for row in values)


def write(tmp_path, text):
    path = tmp_path / "walk.bvh"
    path.write_text(text)
    return path


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


def test_joints_of_a_chain(tmp_path):
    recording = read_markers(write(tmp_path, BVH + rows(np.hstack([ROOT, ANGLES]))), CENTIMETRES)
    assert list(recording.positions) == ["Hips", "Chest", "Arm", "Arm_end"]
    assert recording.rate == pytest.approx(100)
    # x lateral (right) is -x of a person who faces z with y up.
    standard = expected()[..., [0, 2, 1]] * [-1, 1, 1] / 100
    for number, name in enumerate(recording.positions):
        np.testing.assert_allclose(recording[name], standard[:, number], atol=1e-7)


@pytest.mark.parametrize("around", [0.0, 1.0])
def test_joints_with_positions_of_their_own(tmp_path, around):
    """Some suits give every joint six channels, whose positions are zero or the offset once more."""
    text = BVH.replace("CHANNELS 3 Zrotation", "CHANNELS 6 Xposition Yposition Zposition Zrotation")
    offset = np.tile([0, 40 * around, 0], (20, 1))
    values = np.hstack([ROOT, ANGLES[:, :3], offset, ANGLES[:, 3:]])
    recording = read_markers(write(tmp_path, text + rows(values)), CENTIMETRES)
    standard = expected()[..., [0, 2, 1]] * [-1, 1, 1] / 100
    np.testing.assert_allclose(recording["Arm_end"], standard[:, 3], atol=1e-7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("MOTION", "MOTIONS"), "not a BVH file"),
        (lambda text: text.replace("Frames: 20", "Frames: 21"), "Frames: 21; the file holds 20"),
        (lambda text: text.replace("Frame Time: 0.01", "Frame Time: 0"), "Frame Time is 0 s"),
        (lambda text: text.replace("Frame Time:", "Time:"), "line 23: 'Time: 0.01'; 'Frame Time:'"),
        (lambda text: text.replace("}\n}\nMOTION", "}\nMOTION"), "1 joints are not closed"),
        (
            lambda text: text.replace("JOINT Chest", "ROOT Chest"),
            "line 6: 'ROOT Chest'; one ROOT with JOINTs",
        ),
        (lambda text: text.replace("OFFSET 0 40 0", "OFFSET 0 40"), "line 8: 2 numbers; 3 are needed"),
        (lambda text: text.replace("CHANNELS 3 X", "CHANNELS 4 X"), "line 13: 'CHANNELS 4 Xrotation"),
        (lambda text: text.replace("CHANNELS 3 X", "CHANNELS 3 W"), "line 13: 'CHANNELS 3 Wrotation"),
        (lambda text: text.replace("OFFSET 30", "LENGTH 30"), "line 16: 'LENGTH 30 0 0'; ROOT, JOINT"),
        (lambda text: text[: text.rindex(" ")] + "\n", "line 43: 11 numbers; 12 are needed"),
        (lambda text: text[: text.rindex(" ")] + " 1_0\n", "line 43: could not convert"),
        (lambda text: text[: text.rindex(" ")] + " inf\n", "line 43: a number that is not finite"),
    ],
)
def test_files_that_are_refused(tmp_path, change, said):
    path = write(tmp_path, change(BVH + rows(np.hstack([ROOT, ANGLES]))))
    with pytest.raises(InputError) as caught:
        read_markers(path, CENTIMETRES)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_the_unit_has_to_be_declared(tmp_path):
    path = write(tmp_path, BVH + rows(np.hstack([ROOT, ANGLES])))
    with pytest.raises(InputError, match="states no unit"):
        read_markers(path, MarkerLayout(up="+y", forward="+z"))
