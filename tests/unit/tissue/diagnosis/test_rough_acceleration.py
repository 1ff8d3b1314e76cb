"""Noise too small to be seen in a position, but large in the acceleration, is told and does not make a mass too small."""

from __future__ import annotations

import numpy as np
import pytest

import lumbar
from lumbar.records.record import Channel, Record
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair, sensor_faults
from lumbar.tissue.models.motion import Motion

STEP, MASS, DAMPING = 1e-3, 0.09, 0.2
TIME = np.arange(20_000) * STEP
LINES = 0.4 * np.arange(1, 40, 2)


def moved_mass(noise: float, mass: float = MASS, stiffness: float = 0.0) -> Record:
    """Mass and damper under a sum of sines, with closed-form derivatives, and noise (mm) of the encoder."""
    random = np.random.default_rng(3)
    phase = random.uniform(0, 2 * np.pi, len(LINES))
    angle = 2 * np.pi * LINES * TIME[:, None] + phase
    rate, size = 2 * np.pi * LINES, 20 / (1 + LINES**2)
    position, speed = (size * np.sin(angle)).sum(axis=1), (size * rate * np.cos(angle)).sum(axis=1)
    force = stiffness * position + DAMPING * speed - mass * (size * rate**2 * np.sin(angle)).sum(axis=1)
    force += random.normal(0, 0.01 * np.std(force), len(force))
    seen = position + noise * random.standard_normal(len(TIME))
    channels = {"input": Channel(seen, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record("axis", TIME, channels)


def told_mass(record: Record) -> float:
    motion = Motion.of(record)
    columns = np.column_stack([np.ones(len(motion)), motion.position, motion.velocity, motion.acceleration])
    inside = slice(500, -500)
    return float(np.linalg.lstsq(columns[inside], record["output"][inside], rcond=None)[0][3])


def test_a_mass_is_as_large_as_without_the_noise():
    noisy = moved_mass(noise=2e-4)
    assert told_mass(noisy) < 0.97 * MASS
    faults = sensor_faults(noisy)
    assert faults
    assert told_mass(repair([noisy])[0][0]) == pytest.approx(MASS, rel=0.005)


@pytest.mark.parametrize(
    "record",
    [moved_mass(noise=0.0), moved_mass(noise=2e-4, mass=0.0, stiffness=0.5)],
    ids=["without noise", "without mass"],
)
def test_nothing_is_told_where_no_mass_suffers(record):
    assert "rough_acceleration" not in [item.kind for item in sensor_faults(record)]


def test_the_positioning_axis_has_its_published_mass_at_its_own_rate(shared):
    """95.1 kg, published of records through an 80 Hz filter; 86.8 kg come out of the 1 kHz records as they are."""
    columns = {
        "time": ColumnSettings("t", "s", "time"),
        "input": ColumnSettings("qm", "mm", "position", scale=1000.0),
        "output": ColumnSettings("vir", "N", "force", scale=35.15065188),
    }
    files = [shared / "real" / "positioning_axis" / f"DATA_EMPS{part}.mat" for part in ("", "_PULSES")]
    records = lumbar.read(
        files, layout=ColumnLayout(columns=columns, format="mat"), names=("reference", "pulses")
    )
    assert records[0].sampling_time == pytest.approx(1e-3)
    assert 1e3 * told_mass(records[0]) < 88
    (fault,) = sensor_faults(records[0])
    assert fault.kind == "rough_acceleration"
    assert fault.value == pytest.approx(80, abs=10)
    refined = lumbar.refine(list(records), ["inertia", "coulomb_friction"], base="KV", train="reference")
    mass = refined.models[-1]["inertia.mass"]
    assert 1e3 * mass.value == pytest.approx(95.1, rel=0.005)
    assert 1e3 * mass.low < 95.1 < 1e3 * mass.high
