"""Records at the edge of what can be diagnosed: an answer, or one line that says what is wrong with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from periodic_records import multisine, noise, record, relaxing_force

import lumbar
from lumbar.base.errors import InputError
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings

ONE_EFFECT = StudySettings(improvement=ImprovementSettings(most_effects=1))


def diagnosed(position, force):
    found = lumbar.diagnose([record(position, force)], settings=ONE_EFFECT)
    assert str(found.add().locate()) and str(found.add().compare())
    return found


@pytest.mark.parametrize("lines", [np.arange(1, 26), np.arange(1, 250)], ids=["low band", "up to Nyquist"])
def test_a_force_that_repeats_exactly_is_diagnosed(lines):
    position = multisine(5, lines=lines)
    found = diagnosed(position, np.tile(relaxing_force(position)[-500:], 5))
    assert "alike to the last digit" in str(found)


def test_an_input_whose_band_reaches_up_to_nyquist_is_diagnosed():
    position = noise(2000, 3)
    assert diagnosed(position, relaxing_force(position) + 0.05 * noise(2000, 4))


def test_sixty_samples_at_ten_hertz_are_located():
    position = np.cumsum(noise(60, 5))
    test = record(position, relaxing_force(position) + 0.01 * noise(60, 6))
    slow = lumbar.diagnose([_at(test, 0.1)], settings=ONE_EFFECT)
    assert str(slow.add().locate())


def test_sixty_samples_at_a_hundred_hertz_are_too_few():
    position = np.cumsum(noise(60, 5))
    with pytest.raises(InputError, match="too short"):
        lumbar.diagnose([record(position, relaxing_force(position))])


def test_values_that_are_all_equal_are_refused(tmp_path):
    time = np.arange(300) * 0.01
    for name, columns in (("position", (0 * time, time)), ("force", (np.sin(time), 0 * time))):
        path = tmp_path / f"{name}.csv"
        table = np.column_stack([time, *columns])
        np.savetxt(path, table, delimiter=",", header="time_s,position_mm,force_N", comments="")
        with pytest.raises(InputError, match="constant"):
            lumbar.read(path)


def _at(test, step):
    return replace(test, time=np.arange(len(test)) * step)
