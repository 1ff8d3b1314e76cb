"""What a right model leaves beside the noise floor: it counts as noise, and real effects are named all the same."""

from dataclasses import replace

import pytest
from leading_records import leading
from periodic_records import noise

from lumbar.tissue.diagnosis.selection.candidate import is_adequate
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.verdict import noise_sentence


def read_with_noise(sigma: float, **law):
    records = leading(0, **law)
    return [
        item.with_values(input=item["input"] + sigma * noise(len(item), 70 + number))
        for number, item in enumerate(records)
    ]


@pytest.fixture(scope="module", params=[0.02, 0.05])
def noisy(request):
    return diagnose(read_with_noise(request.param))


def test_the_force_of_known_position_noise_within_the_band_is_nothing_missing(noisy):
    experiment = noisy.experiment
    assert noisy.verdict == "adequate" and noisy.base.fit.structure.base.name == "KB"
    assert not is_adequate(noisy.base, replace(experiment, position_noise_force=0.0))
    expected = (noisy.base.train_rms**2 - experiment.noise**2) ** 0.5
    assert experiment.position_noise_force == pytest.approx(expected, rel=0.35)
    assert f"a right model would leave {experiment.position_noise_force:.3g} N" in noise_sentence(experiment)


def test_an_effect_is_named_beside_it():
    found = diagnose(read_with_noise(0.02, branch=0.0, hardening=0.01))
    assert found.selected == ("hardening_stiffness",) and found.verdict == "named"


def test_a_drift_that_may_be_a_wandering_zero_belongs_to_the_limit(noisy):
    floor = noisy.experiment.floor
    size = 0.5 * floor.rms * (2.326 * (2 / floor.degrees_of_freedom) ** 0.5) ** 0.5
    said = (("drift: the level changes", size),)
    small = replace(noisy.experiment, position_noise_force=0.0)
    wandering = replace(small, floor=replace(floor, structured=said, structured_rms=size))
    sure = replace(
        small, floor=replace(floor, structured=((said[0][0], floor.rms),), structured_rms=floor.rms)
    )
    assert (small.beside_floor, wandering.beside_floor, sure.beside_floor) == (0.0, pytest.approx(size), 0.0)
