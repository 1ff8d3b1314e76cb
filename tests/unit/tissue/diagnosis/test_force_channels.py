"""Exchanged or inverted channels of the force are reported, with the columns that read them correctly."""

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
import yaml

from lumbar.base.errors import InputError
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.spatial.location_in_space import cells, directions
from lumbar.tissue.diagnosis.spatial.spatial_data import axis_floors, prepare
from lumbar.tissue.diagnosis.spatial.spatial_findings import exchanged_channels
from space_records import FRICTION, NOISE, POSITION, STIFFNESS, record, record_of, white

TURNED = np.array([[0.9, -0.4, 0.2], [-0.4, 0.5, 0.1], [0.2, 0.1, 0.3]])
"""Stiffness in addition to the spring's, positive with it, in no frame of the axes."""


def find_exchange(item):
    return exchanged_channels(prepare([item], DiagnosisSettings()), None)


def misread(order, signs):
    force = STIFFNESS * POSITION + TURNED @ POSITION + FRICTION + white()
    wrong = np.array(signs)[:, None] * force[list(order)]
    return record_of("multisine", record(FRICTION).time, POSITION, wrong, "xyz")


READINGS = [*product(permutations(range(3)), product((1, -1), repeat=3))]


@pytest.mark.parametrize(
    ("order", "signs"),
    [
        pytest.param(*reading, marks=[pytest.mark.acceptance] * (number % 9 > 0))
        for number, reading in enumerate(READINGS[1:])
    ],
)
def test_every_wrong_reading_is_reported_with_its_columns(order, signs):
    result = find_exchange(misread(order, signs))
    columns = yaml.safe_load(result.sentence.partition("\n")[2])["tissue"]["layout"]["columns"]
    for axis, name in enumerate("xyz"):
        column = columns[f"output_{name}"]
        at = order.index(axis)
        assert column["column"] == f"force_{'xyz'[at]}_N"
        assert column.get("scale", 1.0) == signs[at]
    assert result.value > 90


@pytest.mark.parametrize("axes", ["xyz", "xz"])
def test_correct_channels_are_not_reported(axes):
    assert find_exchange(record(FRICTION, axes=axes)) is None
    assert find_exchange(misread(*READINGS[0])) is None


def test_exchanged_channels_have_no_effect():
    result = diagnose([misread((0, 1, 2), (1, 1, -1))], DiagnosisSettings())
    assert (result.status, result.selected) == ("unexplained", ())
    assert result.orientation.kind == "force_channels"


def test_dead_channel_is_rejected():
    item = record(FRICTION)
    dead = replace(item.with_values(output_z=np.zeros(len(item))), name="bench")
    with pytest.raises(InputError, match=r"^bench: .*\bz\b.*\b0 N\b"):
        diagnose([dead], DiagnosisSettings())


def test_cells_of_directions_have_one_size_and_contain_their_centres():
    for axes in (2, 3):
        centres = directions(axes)
        assert cells(centres.T).tolist() == list(range(len(centres)))
        drawn = np.random.default_rng(0).standard_normal((axes, 200_000))
        shares = np.bincount(cells(drawn), minlength=len(centres)) / 200_000
        assert shares == pytest.approx(1 / len(centres), rel=0.1)


def test_noise_floor_of_axes_with_different_periods_and_of_a_resting_axis():
    time, random = 0.01 * np.arange(6000), np.random.default_rng(3)
    # Two axes repeat after 4 and 5 s, both after 20 s; the third is held, and its encoder has noise.
    position = np.stack(
        [np.sin(np.pi * time / 2), np.sin(0.4 * np.pi * time), 0.001 * random.normal(size=6000)]
    )
    force = 0.5 * position + NOISE * random.normal(size=position.shape)
    floors = axis_floors(record_of("orbits", time, position, force, "xyz"))
    assert [floor.period for floor in floors] == pytest.approx([20.0] * 3)
    assert [floor.rms for floor in floors] == pytest.approx([NOISE] * 3, rel=0.1)
