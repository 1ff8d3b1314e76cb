"""Views of a model's error in space, for errors of known direction, size and work and for noise of several kinds."""

import re

import numpy as np
import pytest
from markupsafe import escape
from scipy.signal import lfilter

import lumbar
from space_records import FRICTION, NOISE, POSITION, SAMPLES, SPEED, STEP, TIME, VELOCITY, record, white

ACROSS = np.cross(VELOCITY, np.array([0.3, -0.5, 0.8]), axis=0)
DIRECTION = np.array([2, -1, 2]) / 3


@pytest.fixture(scope="module")
def spring():
    return lumbar.refine([record(np.zeros_like(POSITION))], [], base="LE").model


def locate(error, spring, noise=None):
    return lumbar.locate([record(error, noise)], spring)["multisine"]


def cell_centres():
    """Centres of 6 bands of equal height, each divided into 12 angles about z, shape (72, 3)."""
    height, angle = np.meshgrid((np.arange(6) + 0.5) / 3 - 1, (np.arange(12) + 0.5) * np.pi / 6 - np.pi)
    radius = np.sqrt(1 - height**2)
    return (
        np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=2)
        .swapaxes(0, 1)
        .reshape(-1, 3)
    )


def test_friction_acts_along_the_travel_and_takes_work(spring):
    report = locate(FRICTION, spring)
    travel, work = report.views["travel"], report.views["work"]
    assert travel.numbers["along"] > 0.98 and travel.share > 0.9
    assert travel.table["mean"] == pytest.approx(0.4, abs=0.01)
    path = float(SPEED[:SAMPLES].sum() * STEP)
    missing = work.table["measured"] - work.table["simulated"]
    assert missing.sum() == pytest.approx(0.4 * path, rel=0.01) and missing.min() > 0
    mean = np.stack([report.views["direction of travel"].table[f"mean_{axis}"] for axis in "xyz"], axis=1)
    assert np.nanmin(np.sum(mean * cell_centres(), axis=1)) > 0.3


def test_force_across_the_travel_does_no_work(spring):
    views = locate(0.02 * ACROSS, spring).views
    assert views["travel"].numbers["across"] > 0.98
    assert views["travel"].share == 0.0
    assert views["work"].p_value > 0.01
    assert views["direction of travel"].share > 0.5


def test_missing_stiffness_has_a_direction_and_no_mean_along_the_travel(spring):
    views = locate(0.2 * np.multiply.outer(DIRECTION, DIRECTION @ POSITION), spring).views
    assert views["travel"].share < 0.05
    assert views["direction of the error"].share > 0.97
    principal = [views["direction of the error"].table[f"direction_{axis}"][0] for axis in "xyz"]
    assert np.abs(principal @ DIRECTION) == pytest.approx(1, abs=1e-3)


NOISES = {
    "white": lambda draw: draw,
    "coloured": lambda draw: lfilter([0.4], [1, -0.9], draw),
    "of different size along every axis": lambda draw: draw * np.array([[1.0], [4.0], [0.3]]),
    "shared by the axes": lambda draw: (np.eye(3) + 0.6) @ draw,
}


@pytest.mark.parametrize("kind", NOISES)
def test_noise_is_not_significant_in_any_view(spring, kind):
    report = locate(np.zeros_like(POSITION), spring, NOISES[kind](white(4)))
    assert min(view.p_value for view in report.views.values()) > 0.01
    assert report.is_noise


@pytest.mark.nightly
def test_axes_are_compared_one_by_one_with_a_picture_each(spring, tmp_path):
    records = [record(FRICTION)]
    compared, located = lumbar.compare(records, spring), lumbar.locate(records, spring)
    names = [f"multisine ({axis})" for axis in "xyz"]
    assert list(compared.table.frame["record"]) == names
    assert compared["multisine (y)"].comparison.floor.rms == pytest.approx(NOISE, rel=0.05)
    assert re.search(r"\b3 axes\b", str(located).splitlines()[0])
    located.save(tmp_path)
    drawn = {path.stem for path in tmp_path.glob("*.svg")}
    assert drawn == {"location_multisine", *(f"location_multisine_{axis}" for axis in "xyz")}
    assert set(located.table.frame["record"]) == {"multisine", *names}
    page = (tmp_path / "location_page.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 4
    assert escape(located["multisine"].views["travel"].sentence) in page


def test_model_of_one_axis_is_rejected_for_several(spring):
    model = lumbar.refine([record(0 * POSITION).axis("x")], [], base="LE").model
    with pytest.raises(lumbar.InputError, match=r"^LE .*\bmultisine\b"):
        lumbar.compare([record(0 * POSITION)], model)


def test_records_in_a_plane_are_located_and_drawn(tmp_path):
    located = lumbar.refine([record(FRICTION, axes="xy")], [], base="LE").locate()
    located.save(tmp_path)
    assert (tmp_path / "location_multisine.svg").is_file()
    assert located["multisine"].views["travel"].numbers["along"] > 0.6


@pytest.mark.nightly
def test_resting_axis_is_reported_and_the_others_are_compared(tmp_path):
    still = record(FRICTION).with_values(input_z=0 * TIME, output_z=0.2 + 0 * TIME)
    refined = lumbar.refine([still], [], base="LE")
    compared, located = refined.compare(), refined.locate()
    assert [item.record.name for item in compared] == ["multisine (x)", "multisine (y)"]
    for result in (compared, located):
        result.save(tmp_path)
        assert result.reports[0].resting == ["z"] and result.reports[0].remarks[0] in str(result)
    assert located["multisine"].views["travel"].numbers["along"] > 0.98
