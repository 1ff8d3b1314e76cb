"""Records with holds: stress-relaxation tests, records of a hold only, zeros shown by a rest, units of records with holds."""

import numpy as np
import pytest
from periodic_records import record

from lumbar.records.record import Record
from lumbar.records.rests import begins_at_rest
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.preparation import check_excitation
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.one_ramp import ramp_speed

STEP, NOISE = 0.05, 0.006
TIME = np.arange(1200) * STEP


def make_record(position, force, name: str, seed: int = 1) -> Record:
    """Return a record at 20 Hz with noise of the force."""
    noisy = force + NOISE * np.random.default_rng(seed).standard_normal(len(force))
    return record(position, noisy, name, step=STEP)


def branch(position: np.ndarray, tau: float) -> np.ndarray:
    """Return the exact force of a Maxwell branch of stiffness 1 for a motion straight between the samples."""
    decay, force = np.exp(-STEP / tau), np.zeros(len(position))
    for sample, moved in enumerate(np.diff(position), 1):
        force[sample] = decay * force[sample - 1] + moved * tau / STEP * (1 - decay)
    return force


def ramp(duration: float, begin: float = 2.0, depth: float = 4.0) -> np.ndarray:
    return depth * np.clip((TIME - begin) / duration, 0, 1)


def relaxation_test(duration: float = 1.0, added=lambda z: 0.0, name: str = "ramp") -> Record:
    z = ramp(duration, begin=1.99)  # corners are between samples
    return make_record(z, 0.6 * z + 1.2 * branch(z, 0.5) + added(z), name, seed=round(10 * duration))


HIDDEN = {
    "adequate": lambda z: 0.0,
    "hardening_stiffness": lambda z: 0.004 * z**3,
    "second_relaxation": lambda z: 0.2 * branch(z, 6.0),
    "coulomb_friction": lambda z: 0.4 * np.append(np.diff(z) > 0, 0.0),
}
FAST = ("adequate", "coulomb_friction")


@pytest.mark.parametrize(
    "hidden", [pytest.param(name, marks=[pytest.mark.statistical] * (name not in FAST)) for name in HIDDEN]
)
def test_one_relaxation_test_names_or_ties_the_effect(hidden):
    result = diagnose([relaxation_test(added=HIDDEN[hidden])])
    names = {*result.selected, *(name for item in result.tied_with for name in item.effects)}
    assert result.status == {"adequate": "adequate", "hardening_stiffness": "named"}.get(hidden, "tied")
    assert hidden in names or not names
    assert ("one_ramp" in {item.kind for item in result.findings}) == (result.status == "tied")
    assert abs(result.model.fit.zero) < 5 * NOISE


def test_ramps_of_several_speeds_distinguish_friction():
    records = [relaxation_test(rise, HIDDEN["coulomb_friction"], f"ramp_{rise}") for rise in (0.5, 2.0, 20.0)]
    result = diagnose(records)
    assert (result.status, result.selected) == ("named", ("coulomb_friction",))


def test_quasi_linear_record_has_no_false_name_or_zero():
    z = ramp(6.0, begin=0.0, depth=2.0)
    kernel = np.fft.rfft((TIME + 0.02) ** -0.2, 2400)
    force = np.fft.irfft(np.fft.rfft(np.diff(np.expm1(2 * z), prepend=0.0), 2400) * kernel)[: len(z)]
    result = diagnose([make_record(z, force / 10, "ramp")], DiagnosisSettings(base="KB"))
    assert result.status in ("tied", "unexplained")
    assert "force_offset" not in {item.kind for item in result.findings}


@pytest.mark.parametrize("count", [0.0, 1e-6])
def test_hold_alone_names_nothing(count):
    flicker = count * np.random.default_rng(2).integers(-1, 2, len(TIME))
    result = diagnose([make_record(2.0 + flicker, 1.0 + np.exp(-TIME / 5), "hold")])
    assert (result.status, result.selected) == ("unexplained", ())
    assert [item.kind for item in result.findings] == ["position_rests"]


def test_holds_of_a_flickering_encoder_have_the_same_unit():
    flicker = 1e-6 * np.random.default_rng(3).integers(-1, 2, len(TIME))
    still, flickering = (make_record(ramp(1.0) + item, ramp(1.0), "a") for item in (0.0, flicker))
    hold = make_record(4.0 + flicker, 4 + np.exp(-TIME), "hold")
    check_excitation(
        still, [flickering, hold, make_record(np.full(len(TIME), 4.0), 4 + np.exp(-TIME), "still")]
    )


@pytest.mark.parametrize(
    ("position", "force", "expected"),
    [
        (ramp(1.0), ramp(1.0), True),
        (ramp(1.0, begin=0.0), ramp(1.0, begin=0.0), True),
        (ramp(1.0), ramp(1.0) + 4 * np.exp(-TIME), False),
        (np.cos(0.3 * TIME), np.cos(0.3 * TIME + 0.3), False),
        (np.ones(len(TIME)), np.exp(-TIME), False),
    ],
    ids=["rest", "unloaded", "relaxing", "reversal", "hold"],
)
def test_only_a_rest_is_a_known_start(position, force, expected):
    assert begins_at_rest(make_record(position, force, "record")) == expected


def test_ramp_speed_is_that_of_one_ramp():
    assert ramp_speed(ramp(4.0), STEP) == pytest.approx(1.0, rel=0.02)
    assert ramp_speed(-ramp(4.0), STEP) == pytest.approx(1.0, rel=0.02)
    assert ramp_speed(ramp(1.0) + ramp(1.0, begin=20.0), STEP) is None
    assert ramp_speed(ramp(4.0) - ramp(4.0, begin=20.0), STEP) is None
    assert ramp_speed(np.ones(100), STEP) is None
