"""Multisine (thesis Eq. 3.1): excited lines, amplitudes, and phases of small crest factor."""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.tissue import MultisineSettings

_SEARCH_OVERSAMPLING = 16
"""Samples per cycle of the highest line in the search for phases: a peak is exact to 2 %."""
_PEAK_OVERSAMPLING = 128
"""Samples per cycle of the highest line for a reported peak, which is exact to 0.03 %."""
_CLIP_LEVELS = np.linspace(0.80, 0.995, 60)
_ITERATIONS_PER_LEVEL = 60


def crest_factor(values: np.ndarray) -> float:
    """Return the crest factor: the largest absolute value divided by the root mean square.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
        Whole, finely sampled periods in any unit.
    """
    return float(np.abs(values).max() / np.sqrt(np.mean(np.square(values))))


def one_period(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray, samples: int) -> np.ndarray:
    """Return one period of Σ A cos(2πk t/T + φ) (thesis Eq. 3.1) on an even grid, shape (samples,).

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples k of the fundamental, 1 <= k < samples/2.
    amplitudes, phases : numpy.ndarray of float, shape (lines,)
        Amplitudes in any unit, phases in radians.
    samples : int
        Samples per period.

    Raises
    ------
    ValueError
        If a line is not between 1 and half the number of samples.
    """
    if lines.min() < 1 or lines.max() >= samples / 2:
        raise ValueError(f"lines {lines.min()} to {lines.max()} do not fit {samples} samples per period")
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = amplitudes * np.exp(1j * phases) * samples / 2
    return np.fft.irfft(spectrum, samples)


def fine_samples(lines: np.ndarray, oversampling: int = _PEAK_OVERSAMPLING) -> int:
    """Return a number of samples per period, a power of two, that resolves a multisine's peak.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples of the fundamental.
    oversampling : int
        Smallest number of samples per period of the highest line.
    """
    return int(2 ** np.ceil(np.log2(oversampling * int(lines.max()))))


def clipped_phases(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Return phases of low crest factor by iterated clipping, in radians from -π to π, shape (lines,).

    Each iteration clips the signal, at a level that rises towards the peak, and adopts the phases of the clipped signal. The
    best phases are returned, so that the crest factor never grows.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples of the fundamental.
    amplitudes : numpy.ndarray, shape (lines,)
        Fixed amplitudes in any unit.
    phases : numpy.ndarray, shape (lines,)
        Phases from which the iteration starts, radians.

    References
    ----------
    E. van der Ouderaa, J. Schoukens, J. Renneboog, IEEE Trans. Instrum. Meas. 37 (1988) 145-147.
    """
    samples = fine_samples(lines, _SEARCH_OVERSAMPLING)
    best = current = phases
    lowest = np.inf
    for level in _CLIP_LEVELS:
        for _ in range(_ITERATIONS_PER_LEVEL):
            signal = one_period(lines, amplitudes, current, samples)
            factor = crest_factor(signal)
            if factor < lowest:
                lowest, best = factor, current
            peak = level * np.abs(signal).max()
            current = np.angle(np.fft.rfft(np.clip(signal, -peak, peak))[lines])
    return best


@dataclass(frozen=True)
class Multisine:
    """Σ A_k cos(2πk t/T + φ_k) over the excited lines k."""

    period: float
    """Period T in seconds."""
    lines: np.ndarray
    """Excited multiples of 1/T, rising, shape (lines,)."""
    amplitudes: np.ndarray
    """Amplitudes A_k in mm, shape (lines,)."""
    phases: np.ndarray
    """Phases φ_k in radians, shape (lines,)."""
    detection_even: np.ndarray
    """Even lines of the band that are not excited; power of a response at these lines shows even nonlinearity."""
    detection_odd: np.ndarray
    """Odd lines of the band that are not excited; power of a response at these lines shows odd nonlinearity."""

    @property
    def frequencies(self) -> np.ndarray:
        """Excited frequencies in Hz."""
        return self.lines / self.period

    @property
    def peak(self) -> float:
        """Largest absolute value in mm, including values between samples."""
        return float(np.abs(self._fine()).max())

    @property
    def crest_factor(self) -> float:
        """Crest factor: peak divided by root mean square."""
        return crest_factor(self._fine())

    def _fine(self) -> np.ndarray:
        return one_period(self.lines, self.amplitudes, self.phases, fine_samples(self.lines))

    def sampled(self, rate: float, periods: int) -> np.ndarray:
        """Return sampled periods from t = 0, shape (periods * period * rate,), mm.

        Parameters
        ----------
        rate : float
            Samples per second, Hz.
        periods : int
            Number of periods.

        Raises
        ------
        InputError
            If a period is not a whole number of samples, so that the periods would not repeat.
        """
        samples = round(self.period * rate)
        if abs(samples - self.period * rate) > 1e-9 * samples:
            raise InputError(
                f"signals.multisine.period_s of {self.period:g} s is {self.period * rate:g} samples at "
                f"{rate:g} Hz; a period must be a whole number of samples"
            )
        return np.tile(one_period(self.lines, self.amplitudes, self.phases, samples), periods)


def schroeder_phases(amplitudes: np.ndarray) -> np.ndarray:
    """Return Schroeder's phases φ_k = −2π Σ_{n<k} (k−n) p_n in radians, with p_n the power share of line n; shape (lines,).

    For N equal amplitudes φ_k = −π k(k−1)/N. The signal sweeps through its lines like a chirp, each for a time in proportion to
    its power. `k` counts the excited lines, so that a signal of odd lines sweeps in half a period, as its odd symmetry requires.

    Parameters
    ----------
    amplitudes : numpy.ndarray, shape (lines,)
        Amplitudes of the excited lines in any unit.

    References
    ----------
    M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85-89, eq. 11.
    """
    share = amplitudes**2 / np.sum(amplitudes**2)
    below = np.concatenate([[0.0], np.cumsum(share)[:-1]])
    return -2 * np.pi * np.cumsum(below)


def design_multisine(band: float, settings: MultisineSettings, seed: int = 0) -> Multisine:
    """Design a multisine of unit RMS (thesis Eq. 3.1) on a full or an odd grid of lines.

    On the odd grid, one random line of every `detection_group` consecutive odd lines is omitted to detect nonlinearity; in
    regular gaps the products of a nonlinearity could be missed.

    Parameters
    ----------
    band : float
        Upper end of the excited band, Hz.
    settings : MultisineSettings
        Period, grid and rule of the phases.
    seed : int
        Seed of the detection lines.

    Raises
    ------
    InputError
        If the band has too few lines.

    References
    ----------
    R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach (2012), section 4.3.
    """
    period, group = settings.period_s, settings.detection_group
    lines = np.arange(1, int(np.floor(band * period + 1e-9)) + 1)
    even = left_out = np.array([], dtype=int)
    if settings.grid == "odd":
        odd, even = lines[::2], lines[1::2]
        if len(odd) < 2 * group:
            raise InputError(
                f"an odd grid of {period:g} s period has {len(odd)} odd line(s) up to {band:g} Hz; at least {2 * group} are "
                f"needed with signals.multisine.detection_group {group}"
            )
        rng = np.random.default_rng([seed, 2])
        starts = range(0, len(odd) - group + 1, group)
        left_out = np.array([odd[start + rng.integers(group)] for start in starts])
        lines = np.setdiff1d(odd, left_out)
    elif not len(lines):
        raise InputError(
            f"a multisine of {period:g} s period has no line up to {band:g} Hz: lengthen signals.multisine.period_s"
        )
    shape = (lines / lines[0]) ** settings.amplitude_exponent
    amplitudes = shape / np.sqrt(np.sum(shape**2) / 2)
    angles = np.zeros(len(lines)) if settings.phases == "zero" else schroeder_phases(amplitudes)
    if settings.phases == "clipped":
        angles = clipped_phases(lines, amplitudes, angles)
    return Multisine(period, lines, amplitudes, angles, even, left_out)
