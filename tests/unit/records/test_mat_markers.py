"""Markers in MATLAB and in packed files: the coordinates of a real recording, whatever holds them; or one clear sentence."""

from __future__ import annotations

import gzip
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

from lumbar.base.errors import InputError
from lumbar.records.force_plates import read_force_plates
from lumbar.records.markers import read_markers
from lumbar.settings.layout import MarkerLayout

LAYOUT = MarkerLayout(check_axes=False)
NAMES = ["CV7", "SJN", "L_IAS", "R_IAS"]


@pytest.fixture(scope="module")
def gait(shared):
    return shared / "real" / "lifting" / "qualisys_ior_gait" / "Qualisys.c3d"


@pytest.fixture(scope="module")
def markers(gait):
    """Four markers of a real gait in millimetres, one of them hidden for five frames."""
    points = {name: 1000 * read_markers(gait, LAYOUT)[name] for name in ("CV7", "SXS", "L_IAS", "R_IAS")}
    points = dict(zip(NAMES, points.values(), strict=True))
    points["SJN"][50:55] = np.nan
    return points


def qualisys(markers, **changed):
    """What QTM exports: markers × (x, y, z, residual) × frames."""
    data = np.stack([np.column_stack([points, np.ones(len(points))]).T for points in markers.values()])
    labelled = {"Count": len(markers), "Labels": np.array(list(markers), dtype=object), "Data": data}
    events = [
        {"Label": "Box release", "Frame": 301, "Time": np.uint8(2)},
        {"Label": "pick up", "Frame": 101, "Time": 1.0},
    ]
    recording = {
        "FrameRate": np.uint8(200),  # MATLAB stores small whole numbers as bytes
        "StartFrame": np.uint8(101),
        "Frames": data.shape[2],
        "Trajectories": {"Labeled": labelled},
    }
    return {"lift_03": recording | {"Events": events} | changed}


def test_what_qtm_exports(tmp_path, markers):
    savemat(tmp_path / "a.mat", qualisys(markers), do_compression=True)
    found = read_markers(tmp_path / "a.mat", LAYOUT)
    for name, points in markers.items():
        np.testing.assert_allclose(found[name], points / 1000, rtol=1e-12)
    assert (found.rate, found.time[0], len(found)) == (200.0, 0.5, len(points))
    assert [(event.label, event.time) for event in found.events] == [("pick up", 1.0), ("Box release", 2.0)]


@pytest.mark.parametrize("form", ["labels", "struct", "one by one", "homogeneous"])
def test_arrays_with_a_clock(tmp_path, markers, form):
    n_frames = len(markers["CV7"])
    time, unit = np.arange(n_frames) / 200, "mm"
    if form in ("labels", "struct"):
        points = np.stack(list(markers.values()), axis=1)
        content = {"labels": np.array(NAMES, dtype=object), "points": points, "time": time, "unit": unit}
        content = {"trial": content} if form == "struct" else content
    else:
        ones = np.ones((n_frames, 1 if form == "homogeneous" else 0))
        content = {name: np.hstack([points, ones]) for name, points in markers.items()}
        content |= {"rate": 200.0, "unit": unit, "EMG": np.zeros((9, 2)), "note": "first try"}
    savemat(tmp_path / "a.mat", content)
    found = read_markers(tmp_path / "a.mat", LAYOUT)
    assert found.rate == 200.0
    for name, points in markers.items():
        np.testing.assert_allclose(found[name], points / 1000, rtol=1e-12)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda points: {"rate": 200.0, **points}, "states no unit; set markers.unit"),
        (lambda points: {"unit": "mm", **points}, "neither time nor rate; set markers.rate_Hz"),
        (
            lambda points: {"unit": "mm", "rate": 200.0, "CV7": points["CV7"], "SJN": points["SJN"][:9]},
            "arrays of 9 and 340",
        ),
        (
            lambda points: {"force": np.zeros((50, 6))},
            "no markers (force); QTM's export (Trajectories.Labeled), labels with",
        ),
        (
            lambda points: {"labels": NAMES, "points": np.zeros((4, 3, 50)), "rate": 100.0, "unit": "mm"},
            "points has the shape 4 × 3 × 50 for 4 labels; frames × markers × 3",
        ),
        (
            lambda points: {**qualisys(points), "again": qualisys(points)["lift_03"]},
            "lift_03, again are several recordings",
        ),
        (lambda points: qualisys(points, FrameRate="EXT"), "FrameRate is 'EXT'"),
        (lambda points: qualisys(points, Trajectories={"Unidentified": 1}), "label the trajectories in QTM"),
        (lambda points: {"unit": "mm", "time": np.zeros(340), **points}, "time runs from 0 to 0 s"),
    ],
)
def test_what_leaves_a_doubt_is_refused(tmp_path, markers, spoil, said):
    savemat(tmp_path / "a.mat", spoil(markers))
    with pytest.raises(InputError) as error:
        read_markers(tmp_path / "a.mat", LAYOUT)
    assert said in str(error.value)


def packed(source, target):
    target.write_bytes(gzip.compress(source.read_bytes()))
    return target


def test_packed_c3d_and_trc_are_what_they_were(tmp_path, shared, gait):
    stands_up = shared / "real" / "lifting" / "sts_trunk_flexion_trc" / "sts_unperturbed_1.trc"
    for source in (gait, stands_up):
        plain = read_markers(source, LAYOUT)
        found = read_markers(packed(source, tmp_path / f"{source.name}.GZ"), LAYOUT)
        assert found.name == source.stem and found.source.endswith(".GZ")
        for name, points in plain.positions.items():
            np.testing.assert_array_equal(found[name], points)
    [one, two] = read_force_plates(tmp_path / f"{gait.name}.GZ", LAYOUT)
    np.testing.assert_array_equal(one.force, read_force_plates(gait, LAYOUT)[0].force)
    assert len(two) == 3400


def test_packed_files_that_are_broken_or_stand_for_more_are_named(tmp_path, gait, markers):
    shutil.copy(gait, tmp_path / "cut.c3d")
    (tmp_path / "cut.c3d").write_bytes(gait.read_bytes()[:-5000])
    with pytest.raises(InputError, match=r"^\S+cut\.c3d\.gz: .*it is cut short"):
        read_markers(packed(tmp_path / "cut.c3d", tmp_path / "cut.c3d.gz"), LAYOUT)
    (tmp_path / "short.trc.gz").write_bytes(gzip.compress(b"PathFileType" * 999)[:-30])
    with pytest.raises(InputError, match=r"short\.trc\.gz: the packed file is cut short"):
        read_markers(tmp_path / "short.trc.gz", LAYOUT)
    hidden = qualisys(markers, Analog=np.zeros(8_000_000))
    savemat(tmp_path / "bomb.mat", hidden, do_compression=True)
    with pytest.raises(InputError, match=r"bomb\.mat: unpacks to more than 50 MB"):
        read_markers(tmp_path / "bomb.mat", LAYOUT)


def test_a_rate_in_the_layout_stands_where_the_file_has_none(tmp_path, markers):
    savemat(tmp_path / "a.mat", {"unit": "mm", **markers})
    assert read_markers(tmp_path / "a.mat", replace(LAYOUT, rate_Hz=200.0)).rate == 200.0
