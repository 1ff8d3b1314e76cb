"""The C3D files of the synthetic twin, read by three readers."""

import warnings

import c3d
import ezc3d
import numpy as np

from lumbar.records.c3d_file import read_c3d
from lumbar.twin.lifting_recordings import write_c3d

LABELS = ["ann:C7", "ann:SACRUM", "box:BOX_1"]


def test_written_file_holds_the_same_for_every_reader(tmp_path):
    points = np.random.default_rng(3).normal(0, 700, (50, 3, 3))
    points[7:9, 1] = np.nan
    path = tmp_path / "lift.c3d"
    write_c3d(path, points, LABELS, 120.0, "mm")
    own = read_c3d(path)
    assert (own.rate, own.unit, list(own.positions), own.notes) == (120, "mm", LABELS, ())
    np.testing.assert_array_equal(own.positions["ann:SACRUM"], points[:, 1].astype("f4"))
    content = ezc3d.c3d(str(path))
    np.testing.assert_array_equal(content["data"]["points"][:3].transpose(2, 1, 0), points.astype("f4"))
    assert content["parameters"]["POINT"]["LABELS"]["value"] == LABELS
    with path.open("rb") as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the analog part, which there is not
        reader = c3d.Reader(stream)
        quads = np.array([quads for _, quads, _ in reader.read_frames()])
    np.testing.assert_array_equal(quads[..., 3] < 0, np.isnan(points[..., 0]))
    assert [label.strip() for label in reader.point_labels] == LABELS
