"""Synthetic tests of a Kelvin–Boltzmann tissue with dry friction and hardening, and little noise.

Tissue, motion and effects are drawn as one pair of the benchmark of the diagnosis (``benchmarks/hidden_effects``).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import lfilter

from lumbar.base.files import write_text
from lumbar.settings.twin import TwoHiddenEffectsSettings

HEADER = "time_s,position_mm,force_N"
PAIR = 1
"""Number of this pair of effects in the benchmark, a part of the seed."""
FORMS = 4
"""Number of forms of friction, and of hardening, from which the benchmark draws."""
SETTLING_S = 0.5
"""Duration in seconds of the start of every record that a residual omits."""
_FIT_STRIDE = 4
"""Grid points per point of a fit, which has 500 Hz: the trapezoidal error is below 0.05 % up to 5 Hz."""
_TOLERANCE = 0.01
"""Relative accuracy of the wanted residual."""
_SEVERITY_STEPS = 6
"""Number of severities tried in rising order, after 0."""


@dataclass(frozen=True)
class Tissue:
    """Spring parallel to a Maxwell branch (spring and dashpot in series)."""

    elastic: float
    """Stiffness at rest kₑ, N/mm."""
    relaxing: float
    """Stiffness k₂ of the Maxwell branch, N/mm."""
    relaxation_s: float
    """Time constant τ of the branch."""

    def force(self, motion: ToolMotion) -> np.ndarray:
        """Return the force in newtons, with the branch relaxed at the first position."""
        branch = maxwell_force(motion.position, motion.step, self.relaxing, self.relaxation_s)
        return self.elastic * motion.position + branch


def maxwell_force(position: np.ndarray, step: float, stiffness: float, relaxation_s: float) -> np.ndarray:
    """Return the force in N of a Maxwell branch, Ḟ = k ż − F/τ with F(0) = 0, by the trapezoidal rule.

    Position in mm, shape (points,), every `step` seconds, stiffness in N/mm. The relative error at frequency f is about
    (2π f step)²/12.
    """
    half = 0.5 * step / relaxation_s
    change = np.diff(position, prepend=position[0])
    return lfilter([stiffness / (1 + half)], [1.0, -(1 - half) / (1 + half)], change)


def residual_rms(motion: ToolMotion, force: np.ndarray) -> float:
    """Return the RMS residual in N of the best Kelvin–Boltzmann tissue, for a force on the simulation's grid.

    Stiffnesses are fitted to the recorded samples after `SETTLING_S` by least squares, the time constant is searched between 2 ms
    and 20 s.
    """
    start = round(SETTLING_S * RATE_HZ)
    coarse, step = motion.position[::_FIT_STRIDE], motion.step * _FIT_STRIDE
    elastic = motion.sampled(motion.position)[start:]
    target = motion.sampled(force)[start:]

    def residual(log_relaxation: float) -> np.ndarray:
        branch = maxwell_force(coarse, step, 1.0, np.exp(log_relaxation))
        relaxing = branch[:: motion.stride // _FIT_STRIDE][start:]
        # Projection on two regressors by the normal equations: fast, and accurate because their sizes are similar.
        gram = np.array([[elastic @ elastic, elastic @ relaxing], [elastic @ relaxing, relaxing @ relaxing]])
        weights = np.linalg.solve(gram, [elastic @ target, relaxing @ target])
        return target - weights[0] * elastic - weights[1] * relaxing

    def cost(log_relaxation: float) -> float:
        return float(np.sum(residual(log_relaxation) ** 2))

    grid = np.log([0.002, 0.004, 0.02, 0.05, 0.1, 0.2, 0.4, 1.2, 8.0, 20.0])
    best = 1 + int(np.argmin([cost(value) for value in grid[1:-1]]))
    bounds = grid[best - 1], grid[best + 1]
    best_fit = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-4})
    return float(np.sqrt(np.mean(residual(best_fit.x) ** 2)))


def severity_leaving(
    wanted_N: float, motion: ToolMotion, force_at: Callable[[float], np.ndarray], least_N: float
) -> float:
    """Return the least severity at which the best Kelvin–Boltzmann tissue leaves a wanted residual.

    If no severity suffices, return the severity with the largest residual. The residual may not rise monotonically; the weakest
    sufficient effect is the most plausible. `wanted_N` is the residual's RMS on the record of `motion`, `least_N` the smallest
    acceptable RMS. `force_at` returns the noise-free force on the simulation's grid at severities from 0 to 1.
    """

    @cache
    def excess(severity: float) -> float:
        return float(np.log(max(residual_rms(motion, force_at(severity)), least_N) / wanted_N))

    def near(severity: float) -> float:
        return 0.0 if abs(excess(severity)) < _TOLERANCE else excess(severity)

    tried = [step / _SEVERITY_STEPS for step in range(_SEVERITY_STEPS + 1)]
    for low, high in pairwise(tried):
        if excess(high) > 0:
            return 0.0 if excess(low) > 0 else float(brentq(near, low, high, xtol=1e-4))
    return max(tried, key=excess)


@dataclass(frozen=True)
class TissueTestRanges:
    """Ranges of tissues and excitations."""

    elastic_N_per_mm: tuple[float, float] = (0.25, 0.9)
    """Stiffness at rest, N/mm."""
    relaxing_over_elastic: tuple[float, float] = (0.7, 2.5)
    """Ratio of the relaxing branch's stiffness to the stiffness at rest."""
    relaxing_N_per_mm: tuple[float, float] = (0.2, 1.9)
    """Limits of the relaxing branch's stiffness, N/mm."""
    relaxation_s: tuple[float, float] = (0.05, 0.35)
    """Time constant of the branch, s."""
    amplitude_mm: tuple[float, float] = (3.0, 8.0)
    """Largest displacement, mm."""
    periods: int = 10
    """Number of periods of 10 s in the multisine."""


def draw_test(rng: np.random.Generator, ranges: TissueTestRanges) -> tuple[Tissue, dict[str, ToolMotion]]:
    """Draw a tissue, and the motions of multisine, chirp and noise."""
    elastic = rng.uniform(*ranges.elastic_N_per_mm)
    relaxing = float(np.clip(elastic * rng.uniform(*ranges.relaxing_over_elastic), *ranges.relaxing_N_per_mm))
    tissue = Tissue(float(elastic), relaxing, log_uniform(rng, *ranges.relaxation_s))
    motions = draw_motions(
        rng,
        peak_mm=float(rng.uniform(*ranges.amplitude_mm)),
        slope=float(rng.choice([0.0, -0.5])),
        schroeder=bool(rng.integers(2)),
        periods=ranges.periods,
    )
    return tissue, motions


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number with a uniform logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def added_strength(force_N: float, unit_N: float, severity: float) -> float:
    """Return the strength of an effect that adds 10⁻⁴ to 3 times the tissue's force, evenly in the logarithm.

    `force_N` is the RMS of the tissue's force, `unit_N` the added force at strength 1, `severity` 0 to 1.
    """
    full = force_N / unit_N
    weakest, strongest = 1e-4 * full, 3.0 * full
    return float(weakest * (strongest / weakest) ** severity)


def two_hidden_effects(
    settings: TwoHiddenEffectsSettings, seed: int, ranges: TissueTestRanges | None = None
) -> dict[str, np.ndarray]:
    """Return the records by name, with time (s), position (mm) and force (N) in columns."""
    rng = np.random.default_rng([seed, PAIR, settings.number])
    tissue, motions = draw_test(rng, ranges or TissueTestRanges())
    # The benchmark also draws size, colour and correlation of the noise and the form of either effect, fixed here.
    rng.random(3)
    for _ in ("friction", "hardening"):
        rng.integers(FORMS)
    speed_mm_s = log_uniform(rng, 0.2, 1.5)
    multisine = motions["multisine"]
    rest = tissue.force(multisine)
    force_N, half_depth = float(rest.std()), 0.5 * float(np.abs(multisine.position).max())
    noise_N = settings.noise_share * force_N

    effects = (
        (lambda motion, strength: strength * 2 / np.pi * np.arctan(motion.velocity / speed_mm_s), 1.0),
        (lambda motion, strength: strength * motion.position**3, half_depth**3),
    )
    strengths = {}
    for effect, unit_N in effects:
        # By itself the effect leaves the wanted residual.
        severity = severity_leaving(
            noise_N * settings.residual_over_noise,
            multisine,
            lambda severity, effect=effect, unit_N=unit_N: (
                rest + effect(multisine, added_strength(force_N, unit_N, severity))
            ),
            least_N=1e-9 * force_N,
        )
        strengths[effect] = added_strength(force_N, unit_N, severity)
    records = {}
    for name, motion in motions.items():
        force = tissue.force(motion)
        for effect, strength in strengths.items():
            force = force + effect(motion, strength)
        clean = motion.sampled(force)
        noise = noise_N * rng.standard_normal(len(clean))
        records[name] = np.column_stack(
            [np.arange(len(clean)) / RATE_HZ, motion.sampled(motion.position), clean + noise]
        )
    return records


def write_records(folder: str | os.PathLike, records: dict[str, np.ndarray]) -> None:
    """Write one CSV file per record: header ``time_s,position_mm,force_N``, five decimals."""
    for name, values in records.items():
        lines = ["%.2f,%.5f,%.5f" % row for row in map(tuple, values.tolist())]  # noqa: UP031 - twice as fast
        write_text(Path(folder) / f"{name}.csv", "\n".join([HEADER, *lines]) + "\n")


RATE_HZ = 100
"""Samples per second of the recorded files."""
OVERSAMPLING = 20
"""Number of grid points of the simulation per recorded sample."""
PERIOD_S = 10.0
"""Period of the multisine, and duration of the chirp and the noise."""
LINES = 50
"""Number of lines of the multisine: 0.1, 0.2 … 5 Hz."""
BAND_HZ = (0.1, 5.0)
"""Band of all signals."""


@dataclass(frozen=True)
class ToolMotion:
    """Motion of a point during one record, on the grid of the simulation."""

    record: str
    """Name of the record."""
    step: float
    """Seconds between grid points."""
    position: np.ndarray
    """Position in mm, shape (points,)."""
    velocity: np.ndarray
    """Velocity in mm/s, shape (points,)."""
    acceleration: np.ndarray
    """Acceleration in mm/s², shape (points,)."""
    stride: int = OVERSAMPLING
    """Grid points per recorded sample."""

    @property
    def time(self) -> np.ndarray:
        """Seconds since the record began."""
        return self.step * np.arange(len(self.position))

    @property
    def path(self) -> np.ndarray:
        """Path travelled since the record began, mm."""
        return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self.position)))])

    def sampled(self, values: np.ndarray) -> np.ndarray:
        """Return the values at the recorded samples."""
        return values[:: self.stride]


def line_spectrum_motion(
    record: str,
    amplitudes: np.ndarray,
    phases: np.ndarray,
    spacing_Hz: float,
    duration_s: float,
    peak_mm: float,
) -> ToolMotion:
    """Return a sum of cosines at multiples of `spacing_Hz`, scaled to a recorded peak.

    Parameters
    ----------
    record : str
        Name of the record.
    amplitudes, phases : numpy.ndarray, shape (lines,)
        Amplitudes (any unit) and phases (radians) of the lines ``spacing_Hz``, ``2 spacing_Hz`` ….
    spacing_Hz, duration_s : float
        Spacing of the lines, with a whole number of samples in 1/spacing_Hz; duration, of whole periods or a part of one.
    peak_mm : float
        Largest recorded displacement.
    """
    rate = RATE_HZ * OVERSAMPLING
    points = round(rate / spacing_Hz)
    spectrum = np.zeros(points // 2 + 1, dtype=complex)
    spectrum[1 : len(amplitudes) + 1] = 0.5 * points * amplitudes * np.exp(1j * phases)
    omega = 2 * np.pi * spacing_Hz * np.arange(len(spectrum))
    total = round(duration_s * rate)
    periods = -(-total // points)
    position, velocity, acceleration = (
        np.tile(np.fft.irfft(spectrum * (1j * omega) ** order, points), periods)[:total] for order in range(3)
    )
    scale = peak_mm / np.abs(position[::OVERSAMPLING]).max()
    return ToolMotion(record, 1 / rate, scale * position, scale * velocity, scale * acceleration)


def chirp_motion(record: str, duration_s: float, peak_mm: float) -> ToolMotion:
    """Return a sine with a frequency that rises linearly through `BAND_HZ`."""
    rate = RATE_HZ * OVERSAMPLING
    time = np.arange(round(duration_s * rate)) / rate
    low, high = BAND_HZ
    phase = 2 * np.pi * (low * time + 0.5 * (high - low) * time**2 / duration_s)
    omega = 2 * np.pi * (low + (high - low) * time / duration_s)
    omega_rate = 2 * np.pi * (high - low) / duration_s
    return ToolMotion(
        record,
        1 / rate,
        peak_mm * np.sin(phase),
        peak_mm * omega * np.cos(phase),
        peak_mm * (omega_rate * np.cos(phase) - omega**2 * np.sin(phase)),
    )


def draw_motions(
    rng: np.random.Generator, peak_mm: float, slope: float, schroeder: bool, periods: int
) -> dict[str, ToolMotion]:
    """Return the motions of the records of an experiment: multisine, chirp, band-limited noise.

    Amplitudes of the multisine's lines are frequency to the power of `slope`; its phases are Schroeder's (IEEE Trans. Inf. Theory
    16, 1970) or random.
    """
    amplitudes = np.arange(1, LINES + 1) ** slope
    if schroeder:
        # φ_n = −2π Σ_{j<n} (n − j) p_j with p_j the share of the power in line j.
        power = amplitudes**2 / np.sum(amplitudes**2)
        phases = -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])
    else:
        phases = rng.uniform(0, 2 * np.pi, LINES)
    multisine = line_spectrum_motion(
        "multisine", amplitudes, phases, 1 / PERIOD_S, periods * PERIOD_S, peak_mm
    )
    # Lines three times as dense as a record of this length resolves: the noise does not repeat and its ends do not meet.
    dense = 3 * LINES
    gains = rng.rayleigh(size=dense) * (np.arange(1, dense + 1) >= 3)
    noise = line_spectrum_motion(
        "noise", gains, rng.uniform(0, 2 * np.pi, dense), 1 / (3 * PERIOD_S), PERIOD_S, peak_mm
    )
    return {"multisine": multisine, "chirp": chirp_motion("chirp", PERIOD_S, peak_mm), "noise": noise}
