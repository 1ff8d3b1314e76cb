"""Where in space a model fails: errors whose direction, size and work are known, and noise of several kinds."""

import numpy as np
import pytest
from markupsafe import escape
from scipy.signal import lfilter

import lumbar
from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.spatial.location_in_space import cells, directions
from lumbar.tissue.diagnosis.spatial.spatial_data import axis_floors
from space_records import (
    FRICTION,
    NOISE,
    POSITION,
    SAMPLES,
    SPEED,
    STEP,
    TIME,
    VELOCITY,
    record,
    record_of,
    white,
)

SIDE = np.cross(VELOCITY, np.array([0.3, -0.5, 0.8]), axis=0)
WAY = np.array([2, -1, 2]) / 3


@pytest.fixture(scope="module")
def spring():
    return lumbar.refine([record(np.zeros_like(POSITION))], [], base="LE").model


def located(error, spring, noise=None):
    return lumbar.locate([record(error, noise)], spring)["multisine"]


def test_friction_lies_along_the_travel_and_costs_its_way(spring):
    found = located(FRICTION, spring)
    travel, work = found.views["travel"], found.views["work"]
    assert travel.numbers["along"] > 0.98 and travel.share > 0.9
    assert travel.table["mean"] == pytest.approx(0.4, abs=0.01)
    way = float(SPEED[:SAMPLES].sum() * STEP)
    missing = work.table["measured"] - work.table["simulated"]
    assert missing.sum() == pytest.approx(0.4 * way, rel=0.01) and missing.min() > 0
    mean = np.stack([found.views["direction of travel"].table[f"mean_{axis}"] for axis in "xyz"], axis=1)
    assert np.nanmin(np.sum(mean * directions(3), axis=1)) > 0.3


def test_a_force_across_the_travel_does_no_work(spring):
    found = located(0.02 * SIDE, spring)
    assert found.views["travel"].numbers["across"] > 0.98
    assert found.views["travel"].share == 0.0
    assert found.views["work"].p_value > 0.01
    assert found.views["direction of travel"].share > 0.5


def test_a_stiffness_that_is_missing_has_no_mean_along_the_travel(spring):
    found = located(0.2 * np.multiply.outer(WAY, WAY @ POSITION), spring)
    assert found.views["travel"].share < 0.05
    assert found.views["direction of the error"].share > 0.97
    pointing = [found.views["direction of the error"].table[f"direction_{axis}"][0] for axis in "xyz"]
    assert np.abs(pointing @ WAY) == pytest.approx(1, abs=1e-3)


NOISES = {
    "white": lambda draw: draw,
    "coloured": lambda draw: lfilter([0.4], [1, -0.9], draw),
    "of different size along every axis": lambda draw: draw * np.array([[1.0], [4.0], [0.3]]),
    "shared by the axes": lambda draw: (np.eye(3) + 0.6) @ draw,
}


@pytest.mark.parametrize("kind", NOISES)
def test_noise_is_seen_nowhere_in_space(spring, kind):
    found = located(np.zeros_like(POSITION), spring, NOISES[kind](white(4)))
    assert min(view.p_value for view in found.views.values()) > 0.01
    assert found.is_noise


def test_cells_have_one_size_and_hold_their_middles():
    for axes in (2, 3):
        middles = directions(axes)
        assert cells(middles.T).tolist() == list(range(len(middles)))
        drawn = np.random.default_rng(0).standard_normal((axes, 200_000))
        shares = np.bincount(cells(drawn), minlength=len(middles)) / 200_000
        assert shares == pytest.approx(1 / len(middles), rel=0.1)


@pytest.mark.nightly
def test_axes_are_compared_and_located_one_by_one_and_pictures_are_named_after_them(spring, tmp_path):
    records = [record(FRICTION)]
    compared, found = lumbar.compare(records, spring), lumbar.locate(records, spring)
    names = [f"multisine ({axis})" for axis in "xyz"]
    assert list(compared.table.frame["record"]) == names
    assert compared["multisine (y)"].comparison.floor.rms == pytest.approx(NOISE, rel=0.05)
    assert str(found).startswith("This record of 3 axes, axis by axis: ")
    found.save(tmp_path)
    drawn = {path.stem for path in tmp_path.glob("*.svg")}
    assert drawn == {"location_multisine", *(f"location_multisine_{axis}" for axis in "xyz")}
    assert set(found.table.frame["record"]) == {"multisine", *names}
    page = (tmp_path / "location_page.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 4
    assert escape(found["multisine"].views["travel"].sentence) in page


def test_a_model_of_one_axis_is_refused_with_what_does(spring):
    model = lumbar.refine([record(0 * POSITION).axis("x")], [], base="LE").model
    with pytest.raises(
        InputError, match="LE is a model of one axis, multisine of several: give one that refine"
    ):
        lumbar.compare([record(0 * POSITION)], model)


def test_a_plane_has_a_picture_of_its_own(spring, tmp_path):
    records = [record(FRICTION, axes="xy")]
    flat = lumbar.refine(records, [], base="LE")
    flat.locate().save(tmp_path)
    assert (tmp_path / "location_multisine.svg").is_file()
    assert flat.locate()["multisine"].views["travel"].numbers["along"] > 0.6


@pytest.mark.nightly
def test_an_axis_along_which_nothing_moves_is_named_and_the_others_are_compared(tmp_path):
    still = record(FRICTION).with_values(input_z=0 * TIME, output_z=0.2 + 0 * TIME)
    flat = lumbar.refine([still], [], base="LE")
    compared, found = flat.compare(), flat.locate()
    assert [item.record.name for item in compared] == ["multisine (x)", "multisine (y)"]
    for told in (compared, found):
        told.save(tmp_path)
        assert told.reports[0].resting == ["z"] and told.reports[0].remarks[0] in str(told)
    assert found["multisine"].views["travel"].numbers["along"] > 0.98


def test_the_noise_of_axes_is_known_where_each_has_a_period_of_its_own_and_one_rests():
    time, random = 0.01 * np.arange(6000), np.random.default_rng(3)
    # Two axes repeat after 4 and 5 s, both after 20 s; the third is held, and its encoder has noise.
    position = np.stack(
        [np.sin(np.pi * time / 2), np.sin(0.4 * np.pi * time), 0.001 * random.normal(size=6000)]
    )
    force = 0.5 * position + NOISE * random.normal(size=position.shape)
    floors = axis_floors(record_of("orbits", time, position, force, "xyz"))
    assert [floor.period for floor in floors] == pytest.approx([20.0] * 3)
    assert [floor.rms for floor in floors] == pytest.approx([NOISE] * 3, rel=0.1)
