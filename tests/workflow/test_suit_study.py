"""A lift as an inertial suit writes it (BVH) becomes a study, and its joints are taken as they are."""

import re

import numpy as np
import pytest
from test_new_study import fill_in

import lumbar
from lumbar.records.markers import read_markers
from refusing import has_tokens

# By joint: the one before it, where it lies from there (left, up and forward, cm), how far it turns (degrees) where the person
# bends down, and while the box is held upright.
SIDE = {
    "UpLeg": ("Hips", (9, -8, 2), -70, 0), "Leg": ("UpLeg", (0, -42, 0), 95, 0), "Foot": ("Leg", (0, -42, 0), -40, 0),
    "ToeBase": ("Foot", (0, -6, 13), 0, 0), "Arm": ("Spine1", (17, 22, 0), -75, -15), "ForeArm": ("Arm", (0, -29, 0), 0, -60),
    "Hand": ("ForeArm", (0, -26, 0), 0, 0),
}  # fmt: skip
TRUNK = {
    "Spine": ("Hips", (0, 8, 0), 12, 0),
    "Spine1": ("Spine", (0, 14, 0), 12, 0),
    "Neck": ("Spine1", (0, 28, 0), 0, 0),
}


def suit(path):
    """Bend to a box, carry it upright, put it down at half the depth, stand up: ankles stay where they are."""
    time = np.arange(0, 9, 0.01)
    rise = lambda start, stop: 0.5 - 0.5 * np.cos(np.pi * np.clip((time - start) / (stop - start), 0, 1))  # noqa: E731
    bend = rise(1, 2.3) - rise(2.5, 4) + 0.45 * (rise(5.2, 6.2) - rise(7, 8))
    held = (rise(2.3, 3) - rise(6.2, 7)) * (1 - bend)
    joints = {"Hips": ("", (0, 0, 0), 15, 0), **TRUNK}
    for side, sign in (("Left", 1), ("Right", -1)):
        for name, (before, (out, *rest), *turns) in SIDE.items():
            joints[side + name] = (side + before if before in SIDE else before, (sign * out, *rest), *turns)
    thigh, shank = np.radians(-55 * bend), np.radians(40 * bend)
    columns = [0 * time, 16 + 42 * (np.cos(thigh) + np.cos(shank)), 42 * (np.sin(thigh) + np.sin(shank)) - 2]

    def written(name):
        _, offset, bending, holding = joints[name]
        columns.extend((0 * time, bending * bend + holding * held, 0 * time))
        inside = [written(child) for child, (before, *_) in joints.items() if before == name]
        inside = "".join(f"JOINT {part}" for part in inside) or "End Site\n{\nOFFSET 0 -3 0\n}\n"
        kinds = ["Xposition Yposition Zposition "] * (name == "Hips") + ["Zrotation Xrotation Yrotation"]
        offset = "OFFSET {} {} {}".format(*offset)
        return f"{name}\n{{\n{offset}\nCHANNELS {6 if name == 'Hips' else 3} {''.join(kinds)}\n{inside}}}\n"

    head = f"HIERARCHY\nROOT {written('Hips')}MOTION\nFrames: {len(time)}\nFrame Time: 0.01\n"
    noise = np.random.default_rng(5).normal(0, 0.02, (len(time), len(columns)))
    rows = np.transpose(columns) + noise
    path.write_text(head + "".join(" ".join(f"{value:.4f}" for value in row) + "\n" for row in rows))


def test_lift_of_a_suit_becomes_pendulums_of_its_joints(tmp_path):
    (file := tmp_path / "lab" / "lift.bvh").parent.mkdir()
    suit(file)
    study, _ = lumbar.new_study(file.parent).save(tmp_path)
    assert not re.search("SACRUM|ASIS", study.read_text())
    fill_in(study)
    study.write_text(study.read_text().replace("unit: FILL_IN", "unit: cm"))
    settings = lumbar.load_settings(study).lifting
    ann = lumbar.SubjectSettings(name="ann", sex="male", mass_kg=75.0, height_m=1.75, experience="novice")
    lift = lumbar.lift(file, ann, 10.0, settings=settings).analysed
    assert lift.events["deposit_start"].time_s == pytest.approx(5.3, abs=0.3) and lift.states
    assert set(lift.centres) == {"thorax", "abdomen", "pelvis"}
    neck, recording = lift.points.points["C7T1"], read_markers(file, settings.markers)
    assert has_tokens(neck.rule, "C7T1…C7")
    at = np.searchsorted(recording.time, lift.recording.time)
    np.testing.assert_allclose(neck.position, recording["C7"][at], atol=2e-3)
