"""A force read ahead of the position, which no effect's name stands for, or with it: then position noise counts as noise."""

from dataclasses import replace

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, record
from scipy.signal import lfilter

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.candidate import is_adequate
from lumbar.tissue.diagnosis.selection.diagnose import diagnose

FINE = 10
"""Steps of the simulation per sample."""


def leading(lead: int, branch: float = 0.8, hardening: float = 0.0, mass: float = 0.0) -> list[Record]:
    """Spring 0.7 N/mm beside a branch of 0.2 s, the force read so many thousandths of a second before the position."""
    made = []
    for name, seed in (("one", 0), ("two", 3)):
        fine = multisine(5, 1000 * FINE, range(1, 60), seed)
        fine *= 5 / np.abs(fine).max()
        step = STEP / FINE
        pole = np.exp(-step / 0.2)
        moved = np.diff(fine, prepend=fine[0])
        elongation = lfilter([(1 - pole) * 0.2 / step], [1.0, -pole], moved)
        force = 0.7 * fine + branch * elongation + hardening * fine**3
        force += mass * np.gradient(np.gradient(fine, step), step)
        read = np.arange(0, len(fine) - max(FINE, lead), FINE)
        output = force[read + lead] + 0.01 * np.std(force) * noise(len(read), seed + 20)
        made.append(record(fine[read], output, name))
    return made


def leads(records, **settings) -> tuple:
    found = diagnose(records, DiagnosisSettings(**settings))
    return found, [item for item in found.findings if item.kind == "force_leads"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("lead", "branch", "hardening"),
    [
        (90, 0.8, 0.0),
        *(
            pytest.param(6, *more, marks=pytest.mark.nightly)
            for more in ((0.8, 0.0), (0.0, 0.0), (0.0, 0.01))
        ),
    ],
)
def test_a_force_that_leads_is_told_by_how_much_and_named_no_mechanism(lead, branch, hardening):
    """Milliseconds, at samples of 10 ms."""
    found, (told,) = leads(leading(lead, branch, hardening))
    assert told.value == pytest.approx(1e-3 * lead, abs=2e-4) and told.unit == "s"
    assert found.status == "unexplained"


@pytest.mark.parametrize("mass", [0.0, 0.0004])
def test_a_force_that_does_not_lead_is_not_said_to(mass):
    found, told = leads(leading(0, mass=mass))
    assert not told and found.selected == (("inertia",) if mass else ())


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
    assert noisy.status == "adequate" and noisy.base.fit.structure.base.name == "KB"
    assert not is_adequate(noisy.base, replace(experiment, position_noise_force=0.0))
    expected = (noisy.base.train_rms**2 - experiment.noise**2) ** 0.5
    assert experiment.position_noise_force == pytest.approx(expected, rel=0.35)
    assert experiment.extra_floor_rms >= experiment.position_noise_force > 0


def test_an_effect_is_named_beside_it():
    found = diagnose(read_with_noise(0.02, branch=0.0, hardening=0.01))
    assert found.selected == ("hardening_stiffness",) and found.status == "named"


def test_a_drift_that_may_be_a_wandering_zero_belongs_to_the_limit(noisy):
    floor = noisy.experiment.floor
    size = 0.5 * floor.rms * (2.326 * (2 / floor.degrees_of_freedom) ** 0.5) ** 0.5
    said = (("drift: the level changes", size),)
    small = replace(noisy.experiment, position_noise_force=0.0)
    wandering = replace(small, floor=replace(floor, structured=said, structured_rms=size))
    sure = replace(
        small, floor=replace(floor, structured=((said[0][0], floor.rms),), structured_rms=floor.rms)
    )
    assert (small.extra_floor_rms, wandering.extra_floor_rms, sure.extra_floor_rms) == (
        0.0,
        pytest.approx(size),
        0.0,
    )
