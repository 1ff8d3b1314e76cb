"""Motion of the tool in continuous time: excitation signals in closed form, exact on a grid far finer than the samples."""

from dataclasses import dataclass

import numpy as np

RATE_HZ = 100
"""Samples per second of the recorded files."""
OVERSAMPLING = 20
"""Grid points of the simulation per recorded sample."""
PERIOD_S = 10.0
"""Period of the multisine, and duration of the chirp and the noise."""
LINES = 50
"""Lines of the multisine: 0.1, 0.2 … 5 Hz."""
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
    """Shape (points,), mm."""
    velocity: np.ndarray
    """Shape (points,), mm/s."""
    acceleration: np.ndarray
    """Shape (points,), mm/s²."""
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
        Of the lines ``spacing_Hz``, ``2 spacing_Hz`` …; radians.
    spacing_Hz : float
        A period 1/spacing_Hz has an integer number of samples.
    duration_s : float
        Whole periods, or the beginning of one.
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
