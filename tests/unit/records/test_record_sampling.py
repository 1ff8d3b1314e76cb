"""Checks of records, records at another rate, and forces in the axes of the position."""

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.records.record import (
    Channel,
    Record,
    check_record,
    require_same_units,
    swap_input_and_output,
    use_load_as_input,
)
from lumbar.records.sampling import resample, rotate_forces
from refusing import has_tokens, refusal

TIME = np.arange(50) / 100


def record_of(time, *channels, name="r") -> Record:
    named = zip(("input", "output"), channels, strict=False)
    return Record(name, np.asarray(time), {role: Channel(np.asarray(v), role, "mm") for role, v in named})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, v: (t, np.where(np.arange(50) == 6, np.nan, v)), r"sample 7\b.*input.*nan"),
        (lambda t, v: (np.where(np.arange(50) == 9, 0.0, t), v), r"sample 10\b.*\b0 s.*\b0\.08 s"),
        (lambda t, v: (t + 0.01 * (np.arange(50) >= 20), v), r"sample 21\b.*\b0\.02 s"),
        (lambda t, v: (t**1.2, v), "evenly"),
    ],
)
def test_records_that_cannot_be_analysed_are_rejected(change, message):
    time, value = change(TIME, np.sin(TIME))
    with pytest.raises(InputError, match=message):
        check_record(record_of(time, value))


def test_clock_with_few_digits_is_even():
    time = np.round(np.arange(300) / 128, 3)
    assert check_record(record_of(time, np.sin(time))).sampling_time == pytest.approx(1 / 128, rel=1e-3)


def test_sets_share_quantities_and_units():
    a, b = record_of(TIME, TIME, TIME, name="a"), record_of(TIME, TIME, TIME, name="b")
    require_same_units([])
    require_same_units([a, b])
    b.channels["output"] = Channel(TIME, "output", "kN")
    assert has_tokens(refusal(require_same_units, [a, b]), "b: output … kN … mm … a")
    message = refusal(require_same_units, [a, record_of(TIME, TIME, name="b")])
    assert has_tokens(message, "b: output … missing")


def test_resampling_removes_frequencies_above_nyquist():
    time = np.arange(4000) / 1000
    slow, fast = np.sin(2 * np.pi * 7 * time), np.sin(2 * np.pi * 180 * time)
    record = record_of(time, slow + fast + 10)
    result = resample(record, 200.0)
    assert result.sampling_time == pytest.approx(1 / 200)
    assert (len(result), result.time[0], result.time[-1]) == (780, 0.05, pytest.approx(3.945))
    # The window's ripple, at every sample: none is left that the filter could not see whole.
    assert result["input"] == pytest.approx(np.sin(2 * np.pi * 7 * result.time) + 10, abs=0.01)
    assert resample(record, 1000.0) is record
    assert has_tokens(refusal(resample, record, 0.3), "1000 Hz … 0.3 Hz … ratio")


@pytest.mark.parametrize("rate", [10.0, 25.0, 50.0, 64.0, 150.0, 400.0])
def test_resampling_does_not_ring_at_ends(rate):
    """Sensors stopped at full speed: a filter that guesses how the motion goes on would make peaks of its own."""
    time = np.arange(2000) / 100
    record = record_of(time, 3 * np.cos(2 * np.pi * 0.31 * time) + 5, 80 * np.cos(2 * np.pi * 0.31 * time))
    result = resample(record, rate)
    assert result["output"] == pytest.approx(80 * np.cos(2 * np.pi * 0.31 * result.time), abs=0.2)
    assert 0 < result.time[0] - time[0] <= 10 / min(rate, 100) + 1e-9
    assert 0 < time[-1] - result.time[-1] <= 11 / min(rate, 100) + 1e-9


def test_short_record_cannot_be_resampled():
    record = record_of(np.arange(200) / 100, np.sin(np.arange(200)))
    assert has_tokens(refusal(resample, record, 10.0), "2 s … 10 Hz … 10 samples")


def test_several_axes_are_cut_and_resampled_like_one():
    time = np.arange(400) / 100
    waves = np.sin(np.outer([3, 4, 5, 7, 8], time))
    names = ("position", "position", "force", "force", "heat")
    roles = ("input_x", "input_y", "output_x", "output_y", "heat")
    channels = {role: Channel(*item, "") for role, *item in zip(roles, waves, names, strict=True)}
    record = Record("trial", time, channels)
    assert record.between(1, 2).stacked("input") == pytest.approx(record.stacked("input")[:, 100:200])
    slower, alone = resample(record, 50), resample(record.axis("y"), 50)
    assert slower["output_y"] == pytest.approx(alone["output"], rel=1e-12)
    assert list(alone.channels) == ["input", "output", "heat"]
    assert use_load_as_input(record).stacked("input") == pytest.approx(record.stacked("output"))
    swapped = use_load_as_input(swap_input_and_output(record))
    assert swapped.stacked("input") == pytest.approx(record.stacked("output"))


def record_of_axes(axes: str) -> Record:
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
def test_forces_are_rotated_about_vector(vector):
    given = record_of_axes("xyz")
    turned = rotate_forces(given, vector)
    expected = rodrigues(vector, given.stacked("output"))
    assert turned.stacked("output") == pytest.approx(expected, abs=1e-14)
    assert np.array_equal(turned.stacked("input"), given.stacked("input"))
    assert rotate_forces(swap_input_and_output(given), vector).stacked("input") == pytest.approx(
        expected, abs=1e-14
    )


@pytest.mark.parametrize(("axes", "normal", "sign"), [("xy", 2, 1), ("xz", 1, -1), ("yz", 0, 1)])
def test_two_axes_are_rotated_only_in_their_plane(axes, normal, sign):
    vector = np.zeros(3)
    vector[normal] = sign * 90
    one, other = record_of_axes(axes).stacked("output")
    turned = rotate_forces(record_of_axes(axes), vector).stacked("output")
    assert turned == pytest.approx(np.stack([-other, one]), abs=1e-14)
    with pytest.raises(InputError, match=rf"trial.*tissue\.force_frame.* along {'xyz'[normal]}\b"):
        rotate_forces(record_of_axes(axes), [5, 5, 5])


def test_force_frame_needs_several_axes():
    given = record_of_axes("xyz")
    assert rotate_forces(given, None) is given
    assert rotate_forces(given, (0, 0, 0)) is given
    assert has_tokens(refusal(rotate_forces, given.axis("y"), (0, 0, 1)), "trial … one axis")
