"""Forces of a sensor that is mounted turned, in the axes of the position."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record, swap_input_and_output
from lumbar.records.sampling import rotate_forces
from refusing import refusal

TIME = np.arange(40) / 10


def record(axes: str) -> Record:
    values = {axis: np.sin((2 + at) * TIME + at) for at, axis in enumerate(axes)}
    moved = {f"input_{axis}": Channel(item, "position", "mm") for axis, item in values.items()}
    return Record(
        "trial",
        TIME,
        moved | {f"output_{axis}": Channel(item[::-1] + 1, "force", "N") for axis, item in values.items()},
    )


def rodrigues(vector, forces: np.ndarray) -> np.ndarray:
    """Forces, shape (3, samples), turned by a vector in degrees."""
    angle = np.radians(np.linalg.norm(vector))
    axis = np.asarray(vector, dtype=float)[:, None] / np.linalg.norm(vector)
    along = axis * (axis * forces).sum(axis=0)
    return along + np.cos(angle) * (forces - along) + np.sin(angle) * np.cross(axis, forces, axis=0)


@pytest.mark.parametrize("vector", [(20.0, -35.0, 50.0), (0, 0, 90), (180, 0, 0), (1e-5, 0, 0)])
def test_forces_are_turned_about_the_vector(vector):
    given = record("xyz")
    turned = rotate_forces(given, vector)
    expected = rodrigues(vector, given.stacked("output"))
    assert turned.stacked("output") == pytest.approx(expected, abs=1e-14)
    assert np.array_equal(turned.stacked("input"), given.stacked("input"))
    assert rotate_forces(swap_input_and_output(given), vector).stacked("input") == pytest.approx(
        expected, abs=1e-14
    )


@pytest.mark.parametrize(("axes", "normal", "sign"), [("xy", 2, 1), ("xz", 1, -1), ("yz", 0, 1)])
def test_two_axes_are_turned_in_their_plane_alone(axes, normal, sign):
    vector = np.zeros(3)
    vector[normal] = sign * 90
    one, other = record(axes).stacked("output")
    turned = rotate_forces(record(axes), vector).stacked("output")
    assert turned == pytest.approx(np.stack([-other, one]), abs=1e-14)
    with pytest.raises(InputError, match=rf"only its component along {'xyz'[normal]} may differ from 0"):
        rotate_forces(record(axes), [5, 5, 5])


def test_one_axis_has_no_frame_and_none_changes_nothing():
    given = record("xyz")
    assert rotate_forces(given, None) is given
    assert rotate_forces(given, (0, 0, 0)) is given
    assert "has one axis" in refusal(rotate_forces, given.axis("y"), (0, 0, 1))
