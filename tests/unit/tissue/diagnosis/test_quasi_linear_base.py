"""Quasi-linear bases in a diagnosis: after linear bases with effects, and never instead of one that leaves only noise."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

import lumbar
from lumbar.records.record import Channel, Record

SETTINGS = lumbar.StudySettings(improvement=lumbar.ImprovementSettings(most_effects=1, propose_law=False))


def ramp_and_hold(ramp_s: float, seed: int, depth_mm: float = 2.0, rate_Hz: int = 2) -> Record:
    """Return a minute of Fung's exponential of length 0.5 mm that relaxes as (t + 0.02 s)^-0.2, with noise of 0.03 N."""
    fine, every = np.arange(60_000) / 1000, slice(None, None, 1000 // rate_Hz)
    position = depth_mm * np.clip(fine / ramp_s, 0, 1)
    force = fftconvolve(np.diff(np.expm1(position / 0.5)), (fine + 0.0205) ** -0.2)[: len(fine) - 1]
    force = np.append(0, force)[every] * 10 / np.expm1(4)
    noise = 0.03 * np.random.default_rng(seed).standard_normal(len(force))
    channels = {
        "input": Channel(position[every], "position", "mm"),
        "output": Channel(force + noise, "force", "N"),
    }
    return Record(f"ramp_{ramp_s:g}s", fine[every], channels)


@pytest.mark.statistical
def test_a_ramp_of_a_power_law_is_not_named_drift():
    diagnosis = lumbar.diagnose([ramp_and_hold(6, 4)], settings=SETTINGS)
    assert (diagnosis.result.status, diagnosis.selected) == ("adequate", ())
    assert diagnosis.result.base.fit.structure.base.name == "QLV-power"


@pytest.mark.statistical
def test_ramps_that_alone_do_not_determine_the_response_are_fitted_together():
    records = [ramp_and_hold(2, 5, depth_mm=0.5), ramp_and_hold(8, 6)]  # the first is nearly linear
    diagnosis = lumbar.diagnose(records, settings=SETTINGS)
    assert (diagnosis.result.status, diagnosis.selected) == ("adequate", ())
    assert diagnosis.result.base.fit.structure.base.name == "QLV-power"
    assert diagnosis.model["hardening_length"].value == pytest.approx(0.5, rel=0.05)
    assert diagnosis.model["order"].value == pytest.approx(0.2, rel=0.05)
    assert "trained_together" in [item.kind for item in diagnosis.result.findings]
