"""Tissue tests that their force drove, simulated apart from the library: force in, motion out."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

from lumbar.records.record import Channel, Record
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import ImprovementSettings

STEP = 0.01
MASS, STIFFNESS, VISCOSITY = 0.002, 1.0, 0.03
"""N s²/mm, N/mm, N s/mm."""
ZERO = 0.1
"""Of the motion's sensor, in mm."""
FORCE_IN = StudySettings(improvement=ImprovementSettings(forward=True))
BESIDE = {
    "nothing": lambda z, v: 0.0,
    "hardening_stiffness": lambda z, v: 0.4 * z**3,
    "viscoelastic": lambda z, v: 0.4 * z**3 + 0.02 * z**2 * v,
    "coulomb_friction": lambda z, v: 0.25 * np.tanh(v / 0.2),
    "quadratic_damping": lambda z, v: 0.01 * v * abs(v),
}
"""Force beside the base, in N, of position and speed in mm and s."""


def driving_force(period: float, periods: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Time, and a random-phase multisine up to 5 Hz of 0.7 N RMS."""
    random = np.random.default_rng(seed)
    time = STEP * np.arange(round(period * periods / STEP))
    lines = np.arange(1, round(5 * period) + 1) / period
    phases = random.uniform(0, 2 * np.pi, len(lines))
    force = np.cos(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    return time, 0.7 * force / force.std()


def motion_of(hidden: str, time: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Position in mm; ``hysteresis`` is Bouc and Wen's with a state of its own."""
    at = make_interp_spline(time, force, k=3)

    def rates(t, y):
        z, v = y[:2]
        beside = 0.3 * y[2] if hidden == "hysteresis" else BESIDE[hidden](z, v)
        found = [v, (at(t) - STIFFNESS * z - VISCOSITY * v - beside) / MASS]
        return [*found, v / 0.3 * (1 - max(y[2] * np.sign(v), 0.0) ** 2)] if hidden == "hysteresis" else found

    start = np.zeros(3 if hidden == "hysteresis" else 2)
    return solve_ivp(rates, (0, time[-1]), start, t_eval=time, rtol=1e-7, atol=1e-9, max_step=STEP).y[0]


def measured(name: str, time, force, position, seed: int, noise: float = 0.01) -> Record:
    """A record whose motion has white noise, as a share of its standard deviation, and a zero of its own."""
    position = (
        position
        + noise * np.std(position) * np.random.default_rng(seed).standard_normal(len(position))
        + ZERO
    )
    channels = {"input": Channel(force, "force", "N"), "output": Channel(position, "position", "mm")}
    return Record(name, time, channels, source=name)


def forward_records(hidden: str, seed: int = 0) -> list[Record]:
    """Three periods to fit to, and another multisine."""
    records = []
    for name, period, periods, own in (("train", 6.0, 3, 3 * seed + 1), ("other", 9.0, 1, 3 * seed + 2)):
        time, force = driving_force(period, periods, own)
        records.append(measured(name, time, force, motion_of(hidden, time, force), own + 50))
    return records


def records_behind(sensor) -> list[Record]:
    """Two poles on a random command of two levels, as a sensor gives them that makes something else of the motion."""
    records = []
    for name, seconds, seed in (("train", 16.0, 1), ("other", 8.0, 2)):
        time = STEP * np.arange(round(seconds / STEP))
        command = np.repeat(np.sign(np.random.default_rng(seed).standard_normal(len(time) // 20)), 20)
        # Held between samples: the solver interpolates, so on a grid fine enough.
        fine = np.repeat(command, 10)
        speed = lsim(([1.0], [0.02, 0.25, 1.0]), fine, STEP / 10 * np.arange(len(fine)))[1][::10]
        records.append(measured(name, time, command, sensor(speed) - ZERO, seed))
    return records
