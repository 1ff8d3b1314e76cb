"""Synthetic surgeon trials: what the configuration promises, by estimators that are not the library's."""

from dataclasses import replace

import numpy as np
import pytest

from lumbar.base.errors import InputError
from lumbar.twin.surgeon_recordings import minimum_jerk_chain, surgeon_trial, tremor_noise
from study_settings import study_settings


@pytest.fixture(scope="module")
def settings(project):
    return study_settings().twin.surgeon


def test_strokes_become_shallower(settings):
    """Over many trials without noise: depth of the strokes in the last third against the first."""
    one = replace(settings.surgeons["surgeon_1"], tremor_rms_mm=0.0)
    quiet = replace(
        settings, noise_rms_mm=0.0, reposition_mm=0.0, gain_mm_per_stroke=0.0, surgeons={"one": one}
    )
    depths = [surgeon_trial(f"t{index}", "one", quiet, 1).z_mm.to_numpy() for index in range(30)]
    early = np.mean([depth[1000:2000].max() for depth in depths]) - settings.puncture_mm
    late = np.mean([depth[4900:5900].max() for depth in depths]) - settings.puncture_mm
    assert late / early == pytest.approx(0.49 / 0.85, abs=0.12)


def test_tremor_has_its_strength_and_place():
    tremor = tremor_noise(200_000, 100.0, 9.0, 1.0, np.random.default_rng(1))
    assert np.sqrt(np.mean(tremor**2)) == pytest.approx(1, abs=0.03)
    frequency = np.fft.rfftfreq(len(tremor), 0.01)
    power = np.abs(np.fft.rfft(tremor)) ** 2
    centre = np.average(frequency, weights=power)
    assert centre == pytest.approx(9, abs=0.05)
    assert np.sqrt(np.average((frequency - centre) ** 2, weights=power)) == pytest.approx(1, abs=0.05)


def test_minimum_jerk_movement_has_its_closed_form():
    time = np.linspace(0, 3, 3001)
    position = minimum_jerk_chain(time, np.array([1.0]), np.array([0.5]), np.array([2.0, 12.0]))
    assert position[time <= 1].tolist() == [2.0] * 1001
    assert position[time >= 1.5] == pytest.approx(12.0)
    assert np.abs(np.gradient(position, time)).max() == pytest.approx(1.875 * 10 / 0.5, rel=1e-4)
    assert position[1250] == pytest.approx(7.0)


def test_a_trial_is_the_same_bytes_whatever_else_there_is(settings):
    first = surgeon_trial("surgeon_1_trial_1", "surgeon_1", settings, 45)
    fewer = replace(settings, surgeons={"surgeon_1": settings.surgeons["surgeon_1"]})
    assert first.to_csv() == surgeon_trial("surgeon_1_trial_1", "surgeon_1", fewer, 45).to_csv()
    assert first.to_csv() != surgeon_trial("surgeon_1_trial_2", "surgeon_1", settings, 45).to_csv()
    assert first.to_csv() != surgeon_trial("surgeon_1_trial_1", "surgeon_1", settings, 46).to_csv()


def test_unknown_surgeon_is_named_with_those_there_are(settings):
    with pytest.raises(InputError, match=r"any is by 'nobody'.*surgeon_1, surgeon_2"):
        surgeon_trial("any", "nobody", settings, 1)


def test_a_trial_shorter_than_the_approach_has_no_stroke(settings):
    trial = surgeon_trial("any", "surgeon_2", replace(settings, duration_s=5), 3)
    assert len(trial) == 5 * settings.rate_Hz
    assert np.isfinite(trial.to_numpy()).all()
