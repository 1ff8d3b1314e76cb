"""Crest factor of a multisine, and phases that make it small."""

from __future__ import annotations

import numpy as np

_SEARCH_OVERSAMPLING = 16
"""Samples per cycle of the highest line while phases are sought: enough to know a peak to 2 %."""
PEAK_OVERSAMPLING = 128
"""Samples per cycle of the highest line where a peak is reported: it is then known to 0.03 %."""
_CLIP_LEVELS = np.linspace(0.80, 0.995, 60)
_ITERATIONS_PER_LEVEL = 60


def crest_factor(values: np.ndarray) -> float:
    """Largest absolute value over the root mean square.

    Parameters
    ----------
    values : numpy.ndarray of float, shape (samples,)
        For a periodic signal whole periods, sampled finely enough to catch the peak.
    """
    return float(np.abs(values).max() / np.sqrt(np.mean(np.square(values))))


def one_period(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray, samples: int) -> np.ndarray:
    """One period of Σ A cos(2πk t/T + φ) (thesis Eq. 3.1) on an even grid, by inverse Fourier transform.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples k of the fundamental, 1 <= k < samples/2.
    amplitudes, phases : numpy.ndarray of float, shape (lines,)
        Amplitudes in any unit, phases in radians.
    samples : int
        Samples per period.

    Returns
    -------
    numpy.ndarray of float, shape (samples,)
    """
    if lines.min() < 1 or lines.max() >= samples / 2:
        raise ValueError(f"lines {lines.min()} to {lines.max()} do not fit {samples} samples per period")
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = amplitudes * np.exp(1j * phases) * samples / 2
    return np.fft.irfft(spectrum, samples)


def fine_samples(lines: np.ndarray, oversampling: int = PEAK_OVERSAMPLING) -> int:
    """Return a number of samples per period (a power of two) at which a multisine's peak can be seen."""
    return int(2 ** np.ceil(np.log2(oversampling * int(lines.max()))))


def clipped_phases(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Phases of low crest factor by iterated clipping, from a first guess.

    The signal is clipped, the phases of the clipped signal are kept, its amplitudes are put back; the
    clipping level rises towards the peak. The best phases seen are returned, so the crest factor never grows.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples of the fundamental.
    amplitudes, phases : numpy.ndarray of float, shape (lines,)
        Amplitudes are kept; phases in radians are where the search starts.

    Returns
    -------
    numpy.ndarray of float, shape (lines,)
        Radians, from -π to π.

    References
    ----------
    E. van der Ouderaa, J. Schoukens, J. Renneboog, IEEE Trans. Instrum. Meas. 37 (1988) 145-147.
    """
    samples = fine_samples(lines, _SEARCH_OVERSAMPLING)
    best = phases
    lowest = crest_factor(one_period(lines, amplitudes, phases, samples))
    current = phases
    for level in _CLIP_LEVELS:
        for _ in range(_ITERATIONS_PER_LEVEL):
            signal = one_period(lines, amplitudes, current, samples)
            reached = crest_factor(signal)
            if reached < lowest:
                lowest, best = reached, current
            peak = level * np.abs(signal).max()
            current = np.angle(np.fft.rfft(np.clip(signal, -peak, peak))[lines])
    return best
