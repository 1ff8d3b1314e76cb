"""What goes on to OpenSim, read back by our readers and by others: 0.1 mm, and the moment of the load that the back bears."""

import xml.etree.ElementTree as ElementTree

import ezc3d
import numpy as np
import pytest
from lifting_cases import true_recording

import lumbar
from lumbar.interface.opensim_export import export_opensim
from lumbar.lifting.measures.back_load import Link, net_moment
from lumbar.lifting.movement.carried_object import box_centre
from lumbar.records.c3d_file import read_c3d
from lumbar.records.c3d_writer import write_c3d
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.subject import TrialSettings
from lumbar.twin.lifting_recordings import write_markers
from study_settings import subject_settings

G = 9.81


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A lift from 1 s on, in which C7 is hidden for a while, with its folder."""
    folder = tmp_path_factory.mktemp("opensim")
    true = true_recording("expert_23kg")
    true.positions["C7"] = np.where(np.arange(len(true))[:, None] // 50 == 15, np.nan, true["C7"])
    write_markers(folder / "lift.c3d", true.positions, true.rate, "ann")
    trial = TrialSettings(box_mass_kg=23.0, markers="lift.c3d", window_s=(1.0, 8.0))
    lift = lumbar.lift(folder / "lift.c3d", subject_settings("expert"), trial=trial, name="ann_23kg")
    export_opensim(lift, folder, G)
    return lift, folder


def test_markers_come_back_within_a_tenth_of_a_millimetre(exported):
    lift, folder = exported
    opensim = MarkerLayout(up="+y", forward="+x")
    read = [read_markers(folder / "ann_23kg.c3d"), read_markers(folder / "ann_23kg.trc", opensim)]
    points = ezc3d.c3d(str(folder / "ann_23kg.c3d"))
    table = np.genfromtxt(folder / "ann_23kg.trc", delimiter="\t", skip_header=6)[:, 2:]
    labels = points["parameters"]["POINT"]["LABELS"]["value"]
    for name, expected in lift.analysed.recording.positions.items():
        number = labels.index(name)
        others = (
            1e-3 * points["data"]["points"][:3, number].T,
            1e-3 * table[:, 3 * number + np.array([2, 0, 1])],
        )
        for found in (*(one[name] for one in read), *others):
            np.testing.assert_allclose(found, expected, atol=1e-4)
    assert np.isnan(read[1]["C7"]).any() and read[0].time[0] == read[1].time[0] == 1.0


def test_the_loads_on_both_hands_bring_up_the_moment_of_the_box(exported):
    lift, folder = exported
    head, *rows = (folder / "ann_23kg_hands.mot").read_text().splitlines()[6:]
    columns = dict(zip(head.split("\t"), np.loadtxt(rows).T, strict=True))
    held = columns["hand_r_force_vy"] < 0
    moment, joint = np.zeros((len(rows), 3)), lift.analysed.points["L5S1"]
    for applied in ElementTree.parse(folder / "ann_23kg_hands.xml").iter("ExternalForce"):
        stems = (applied.findtext(f"{kind}_identifier") for kind in ("point", "force"))
        point, force = (np.stack([columns[f"{stem}{axis}"] for axis in "zxy"], axis=1) for stem in stems)
        moment -= np.cross(point - joint, force)
    recording = lift.analysed.recording
    expected = net_moment(joint, [Link(23.0, box_centre(recording))], recording.rate, G)
    assert held.sum() > 400 and np.abs(moment - expected)[held].max() < 0.01 and not moment[~held].any()


@pytest.mark.parametrize("shape", [(70_000, 2, 3), (20, 300, 3)])
def test_long_recordings_and_many_markers_come_back(tmp_path, shape):
    points = np.random.default_rng(3).normal(0, 700, shape).astype("f4")
    labels = [f"M{number}" for number in range(shape[1])]
    write_c3d(tmp_path / "long.c3d", points, labels, 120.0, first_frame=241)
    own, other = read_c3d(tmp_path / "long.c3d"), ezc3d.c3d(str(tmp_path / "long.c3d"))
    assert (len(own.time), own.time[0], list(own.positions), own.notes) == (shape[0], 2.0, labels, ())
    for found in (np.stack(list(own.positions.values()), axis=1), other["data"]["points"][:3].T):
        np.testing.assert_array_equal(found, points)
