"""Coordinates of C3D files that ezc3d rejects or reads with errors, compared with the package c3d."""

import c3d
import numpy as np
import pytest

from lumbar.records.c3d_file import read_coordinates
from lumbar.records.c3d_structure import check_structure
from lumbar.records.markers import read_markers


@pytest.mark.parametrize("name", ["05_mips_int", "06_mips_float", "29_type1_forceplate"])
def test_same_coordinates_as_the_c3d_package(shared, name):
    """Files that ezc3d rejects or reads with errors."""
    path = shared / "real" / "c3d_edge" / f"{name}.c3d"
    with path.open("rb") as stream:
        frames = list(c3d.Reader(stream).read_frames(copy=True))
    expected = np.array([quads for _, quads, _ in frames])
    points = read_coordinates(path, check_structure(path))
    seen = expected[..., 3] >= 0
    np.testing.assert_array_equal(np.isnan(points).any(axis=2), ~seen)
    np.testing.assert_allclose(points[seen], expected[seen][:, :3], rtol=1e-6, atol=0)


def test_static_pose_of_one_frame_on_request(shared):
    recording = read_markers(shared / "real" / "c3d_edge" / "16_tiny_cube.c3d", minimum_frames=1)
    assert len(recording) == 1
    assert len(recording.positions) == 14
