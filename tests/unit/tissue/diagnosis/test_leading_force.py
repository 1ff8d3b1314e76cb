"""A force that leads the position is reported and is not an effect; the force of position noise counts as noise."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosing import diagnose
from periodic_records import STEP, multisine, noise, record
from scipy.signal import lfilter

FINE = 10
"""Steps of the simulation per sample."""


def leading(lead: int, branch: float = 0.8, hardening: float = 0.0, mass: float = 0.0) -> list:
    """Return records of a spring of 0.7 N/mm and a branch of 0.2 s, with the force read `lead` ms before the position."""
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


def lead_findings(result) -> list:
    return [item for item in result.findings if item.kind == "force_leads"]


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
def test_leading_force_is_reported_and_unexplained(lead, branch, hardening):
    """Milliseconds, at samples of 10 ms."""
    result = diagnose(leading(lead, branch, hardening))
    (finding,) = lead_findings(result)
    assert finding.value == pytest.approx(1e-3 * lead, abs=2e-4) and finding.unit == "s"
    assert result.status == "unexplained"


def test_force_of_a_mass_is_not_a_lead():
    result = diagnose(leading(0, mass=0.0004))
    assert not lead_findings(result) and result.selected == ("inertia",)


def read_with_noise(sigma: float, **law):
    records = leading(0, **law)
    return [
        item.with_values(input=item["input"] + sigma * noise(len(item), 70 + number))
        for number, item in enumerate(records)
    ]


@pytest.fixture(scope="module")
def noisy():
    return diagnose(read_with_noise(0.05))


def test_force_of_position_noise_is_not_missing(noisy):
    experiment = noisy.experiment
    assert not lead_findings(noisy)
    assert noisy.status == "adequate" and noisy.base.fit.structure.base.name == "KB"
    assert noisy.base.test_rms > 1.1 * experiment.noise
    expected = (noisy.base.train_rms**2 - experiment.noise**2) ** 0.5
    assert experiment.position_noise_force == pytest.approx(expected, rel=0.35)
    assert experiment.extra_floor_rms >= experiment.position_noise_force > 0


def test_effect_is_named_in_addition_to_position_noise():
    result = diagnose(read_with_noise(0.02, branch=0.0, hardening=0.01))
    assert result.selected == ("hardening_stiffness",) and result.status == "named"


def test_possible_wandering_zero_counts_as_noise(noisy):
    floor = noisy.experiment.floor
    size = 0.5 * floor.rms * (2.326 * (2 / floor.degrees_of_freedom) ** 0.5) ** 0.5
    structured = (("drift: the level changes", size),)
    small = replace(noisy.experiment, position_noise_force=0.0)
    wandering = replace(small, floor=replace(floor, structured=structured, structured_rms=size))
    sure = replace(
        small, floor=replace(floor, structured=((structured[0][0], floor.rms),), structured_rms=floor.rms)
    )
    assert (small.extra_floor_rms, wandering.extra_floor_rms, sure.extra_floor_rms) == (
        0.0,
        pytest.approx(size),
        0.0,
    )
