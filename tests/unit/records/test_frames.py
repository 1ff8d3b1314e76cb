"""Forces of a sensor that is mounted turned, in the axes of the position."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lumbar.base.errors import InputError
from lumbar.records.frames import with_force_frame
from lumbar.records.record import Channel, Record, exchanged

TIME = np.arange(40) / 10


def record(axes: str) -> Record:
    values = {axis: np.sin((2 + at) * TIME + at) for at, axis in enumerate(axes)}
    moved = {f"input_{axis}": Channel(item, "position", "mm") for axis, item in values.items()}
    return Record(
        "trial",
        TIME,
        moved | {f"output_{axis}": Channel(item[::-1] + 1, "force", "N") for axis, item in values.items()},
    )


@pytest.mark.parametrize("vector", [(20.0, -35.0, 50.0), (0, 0, 90), (180, 0, 0), (1e-7, 0, 0)])
def test_forces_are_turned_as_scipy_turns_them(vector):
    given = record("xyz")
    expected = Rotation.from_rotvec(vector, degrees=True).apply(given.stacked("output").T).T
    turned = with_force_frame(given, vector)
    assert turned.stacked("output") == pytest.approx(expected, abs=1e-14)
    assert np.array_equal(turned.stacked("input"), given.stacked("input"))
    assert with_force_frame(exchanged(given), vector).stacked("input") == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(("axes", "normal"), [("xy", 2), ("xz", 1), ("yz", 0)])
def test_two_axes_are_turned_in_their_plane_alone(axes, normal):
    vector = np.zeros(3)
    vector[normal] = 30
    turned = with_force_frame(record(axes), vector).stacked("output")
    out = np.zeros((3, len(TIME)))
    within = [at for at in range(3) if at != normal]
    out[within] = record(axes).stacked("output")
    assert turned == pytest.approx(
        Rotation.from_rotvec(vector, degrees=True).apply(out.T).T[within], abs=1e-14
    )
    with pytest.raises(InputError, match=rf"only its component along {'xyz'[normal]} may differ from 0"):
        with_force_frame(record(axes), [5, 5, 5])


def test_one_axis_has_no_frame_and_none_changes_nothing():
    given = record("xyz")
    assert with_force_frame(given, None) is given
    assert with_force_frame(given, (0, 0, 0)) is given
    with pytest.raises(InputError, match="has one axis"):
        with_force_frame(given.axis("y"), (0, 0, 1))
