"""Rate-independent mechanisms are named only if several rates show it; a relaxation spectrum is one effect."""

import numpy as np
import pytest
from diagnosing import diagnose
from periodic_records import record
from scipy.signal import lfilter

import lumbar

RATES = (0.01, 0.03, 0.05)
"""Strain per second."""


def triangles(force, rates=RATES, amplitude=5.0, noise=0.004, cycles=4, samples=800):
    """Records of triangles at constant strokes, one for each rate (cycles per second)."""
    result = []
    for number, rate in enumerate(rates):
        time = np.arange(samples) * cycles / rate / samples
        phase = (rate * time) % 1.0
        position = amplitude * (1 - 4 * np.abs(((phase + 0.25) % 1.0) - 0.5))
        values = force(time, position) + noise * np.random.default_rng(number).standard_normal(samples)
        result.append(record(position, values, f"rate_{rate}", step=time[1]))
    return result


def dahl(position, limit, distance):
    """Dahl's friction, straight between samples."""
    state, result = 0.0, [0.0]
    for step in np.diff(position):
        direction = np.sign(step)
        state = direction + (state - direction) * np.exp(-abs(step) / distance)
        result.append(limit * state)
    return np.array(result)


def spectrum(time, drive, shares, times):
    """Sum of Maxwell branches, exact for a drive that is straight between samples."""
    step, result = time[1], np.zeros(len(time))
    for share, constant in zip(shares, times, strict=True):
        decay = np.exp(-step / constant)
        gain = -np.expm1(-step / constant) * constant / step
        result += share * lfilter([gain], [1, -decay], np.diff(drive, prepend=drive[0]))
    return result


def diagnose_one_effect(force, rates=RATES):
    return diagnose(triangles(force, rates), "LE", most_effects=1)


def kinds(result):
    return [item.kind for item in result.findings]


def test_hysteresis_at_several_rates_is_named():
    result = diagnose_one_effect(lambda time, position: 0.3 * position + dahl(position, 0.5, 0.7))
    assert (result.status, result.selected) == ("named", ("hysteresis",))
    assert not {"other_rates_missed", "one_rate"} & set(kinds(result))


def test_rate_dependent_friction_is_not_named_hysteresis():
    def rated(time, position):
        speed = np.abs(np.diff(position)).max() / time[1]
        return 0.3 * position + dahl(position, 0.5 * (1 + 0.6 * np.log10(speed / 0.2)), 0.7)

    result = diagnose_one_effect(rated)
    assert result.status != "named"
    (finding,) = [item for item in result.findings if item.kind == "other_rates_missed"]
    assert finding.value == pytest.approx(5, rel=0.05)


def test_single_rate_is_reported():
    result = diagnose_one_effect(
        lambda time, position: 0.3 * position + dahl(position, 0.5, 0.7), rates=(0.03, 0.031)
    )
    assert "hysteresis" in result.selected
    assert "one_rate" in kinds(result)


@pytest.mark.nightly
def test_rubber_of_large_strain_is_not_named_hysteresis():
    """VHB 4910's peaks: 0.85, 1.05 and 1.13 N at 0.01, 0.03 and 0.05 per second, stretched to three times its length."""
    records, peaks = [], []
    for number, rate in enumerate(RATES):
        time = np.linspace(0, 4 / rate, 400)
        strain = np.where(rate * time < 2, rate * time, 4 - rate * time)
        rubber = (1 + strain) - (1 + strain) ** -2
        force = 0.682 * (0.3 * rubber + spectrum(time, rubber, (0.25, 0.2, 0.15, 0.1), (2, 15, 80, 300)))
        force += 0.004 * np.random.default_rng(number).standard_normal(len(time))
        peaks.append(force.max())
        records.append(record(20 * strain, force, f"rate_{rate}", step=time[1]))
    assert peaks == pytest.approx([0.85, 1.05, 1.13], abs=0.02)
    for base in ("LE", "KB"):
        result = diagnose(records, base, most_effects=2)
        assert result.status != "named" or "hysteresis" not in result.selected


def test_power_law_is_one_spectrum():
    """A springpot by 24 branches, denser and wider than the effect's own six."""
    times = np.geomspace(0.02, 400, 24)

    def springpot(time, position):
        return 0.2 * position + 0.05 * spectrum(time, position, times**-0.3, times)

    records = []
    for number, (step, samples) in enumerate(((0.02, 3000), (0.02, 2000))):
        random = np.random.default_rng(number)
        time = np.arange(samples) * step
        position = np.cos(
            2 * np.pi * np.outer(time, 0.05 * np.arange(1, 60)) + random.uniform(0, 6.28, 59)
        ).sum(axis=1)
        position -= position[0]
        values = springpot(time, position) + 0.005 * random.standard_normal(samples)
        records.append(record(position, values, f"noise_{number}", step=step))
    result = lumbar.refine(records, ["relaxation_spectrum"], base="LE")
    base, model = result.path
    assert model.test_rms < 3 * 0.005 < 0.1 * base.test_rms
