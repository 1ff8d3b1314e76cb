"""Multisine (thesis Eq. 3.1): which lines are excited, with which amplitudes, and phases that make its crest factor small."""

from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError

_SEARCH_OVERSAMPLING = 16
"""Samples per cycle of the highest line in the search for phases: enough to know a peak to 2 %."""
PEAK_OVERSAMPLING = 128
"""Samples per cycle of the highest line where a peak is reported: it is then known to 0.03 %."""
_CLIP_LEVELS = np.linspace(0.80, 0.995, 60)
_ITERATIONS_PER_LEVEL = 60


def crest_factor(values: np.ndarray) -> float:
    """Largest absolute value over the root mean square; of a periodic signal over whole periods, sampled finely."""
    return float(np.abs(values).max() / np.sqrt(np.mean(np.square(values))))


def one_period(lines: np.ndarray, amplitudes: np.ndarray, phases: np.ndarray, samples: int) -> np.ndarray:
    """One period of Σ A cos(2πk t/T + φ) (thesis Eq. 3.1) on an even grid, shape (samples,), by inverse Fourier transform.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples k of the fundamental, 1 <= k < samples/2.
    amplitudes, phases : numpy.ndarray of float, shape (lines,)
        Amplitudes in any unit, phases in radians.
    samples : int
        Samples per period.
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
    """Phases of low crest factor by iterated clipping, from a first guess; in radians from -π to π, shape (lines,).

    The signal is clipped, the phases of the clipped signal are kept, its amplitudes are put back; the
    clipping level rises towards the peak. The best phases seen are returned, so the crest factor never grows.

    Parameters
    ----------
    lines : numpy.ndarray of int, shape (lines,)
        Multiples of the fundamental.
    amplitudes, phases : numpy.ndarray of float, shape (lines,)
        Amplitudes are kept; phases in radians are where the search starts.

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


GRIDS = ("full", "odd")
PHASE_RULES = ("schroeder", "clipped", "zero")


@dataclass(frozen=True)
class Multisine:
    """Σ A_k cos(2πk t/T + φ_k) over the excited lines k."""

    period: float
    """T in seconds."""
    lines: np.ndarray
    """Shape (lines,): excited multiples of 1/T, rising."""
    amplitudes: np.ndarray
    """Shape (lines,): mm."""
    phases: np.ndarray
    """Shape (lines,): radians."""
    detection_even: np.ndarray
    detection_odd: np.ndarray
    """`detection_even`, `detection_odd`: lines of the band that are left out: power found there in a response is even or
    odd nonlinearity."""

    @property
    def frequencies(self) -> np.ndarray:
        """Excited frequencies in Hz."""
        return self.lines / self.period

    @property
    def peak(self) -> float:
        """Largest absolute value, between samples too, mm."""
        return float(np.abs(self._fine()).max())

    @property
    def crest_factor(self) -> float:
        """Peak over root mean square."""
        return crest_factor(self._fine())

    def _fine(self) -> np.ndarray:
        return one_period(self.lines, self.amplitudes, self.phases, fine_samples(self.lines))

    def sampled(self, rate: float, periods: int) -> np.ndarray:
        """`periods` periods at `rate` Hz, from t = 0; shape (periods * period * rate,).

        Raises
        ------
        InputError
            If a period is not a whole number of samples: the periods would not repeat.
        """
        samples = round(self.period * rate)
        if abs(samples - self.period * rate) > 1e-9 * samples:
            raise InputError(
                f"signals.multisine.period_s of {self.period:g} s is {self.period * rate:g} samples at "
                f"{rate:g} Hz; a period must be a whole number of samples"
            )
        return np.tile(one_period(self.lines, self.amplitudes, self.phases, samples), periods)


def schroeder_phases(amplitudes: np.ndarray) -> np.ndarray:
    """Schroeder's phases φ_k = −2π Σ_{n<k} (k−n) p_n in radians, with p_n the share of the power in line n; shape (lines,).

    For N equal amplitudes φ_k = −π k(k−1)/N. The signal then sweeps through its lines like a chirp, each for
    a time in proportion to its power. `k` counts the excited lines, so that a signal of odd lines sweeps in
    half a period, as its odd symmetry demands.

    Parameters
    ----------
    amplitudes : numpy.ndarray of float, shape (lines,)

    References
    ----------
    M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85-89, eq. 11.
    """
    share = amplitudes**2 / np.sum(amplitudes**2)
    below = np.concatenate([[0.0], np.cumsum(share)[:-1]])
    return -2 * np.pi * np.cumsum(below)


def design_multisine(
    period: float,
    band: float,
    grid: str = "full",
    detection_group: int = 4,
    phases: str = "schroeder",
    amplitude_exponent: float = 0.0,
    seed: int = 0,
) -> Multisine:
    """Design a multisine of unit RMS (thesis Eq. 3.1) on a full or an odd grid of lines.

    On the odd grid one line, drawn at random, is left out of every `detection_group` consecutive odd lines to detect
    nonlinearity: random places keep products of regular gaps from hiding.

    Parameters
    ----------
    period : float
        Seconds.
    band : float
        Upper end of the band in Hz; the lowest line is 1/period.
    grid : str
        ``"full"`` (thesis) or ``"odd"``.
    detection_group : int
        Odd lines of which one is left out.
    phases : str
        ``"schroeder"`` (thesis), ``"clipped"`` (lowest crest factor, see
        `lumbar.tissue.signals.multisine.clipped_phases`) or ``"zero"`` (an impulse train; only to compare with).
    amplitude_exponent : float
        Amplitudes are in proportion to f to this power; 0 is flat as in Eq. 3.1.
    seed : int
        For the detection lines.

    Raises
    ------
    InputError
        If the grid or the phases are unknown, or the band has too few lines.

    References
    ----------
    R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach (2012), section 4.3.
    """
    if grid not in GRIDS or phases not in PHASE_RULES:
        raise InputError(
            f"multisine with grid {grid!r} and phases {phases!r}; grids: {', '.join(GRIDS)}; "
            f"phases: {', '.join(PHASE_RULES)}"
        )
    lines = np.arange(1, int(np.floor(band * period + 1e-9)) + 1)
    even = left_out = np.array([], dtype=int)
    if grid == "odd":
        odd, even = lines[::2], lines[1::2]
        if len(odd) < 2 * detection_group:
            raise InputError(
                f"an odd grid of {period:g} s period has {len(odd)} odd line(s) up to {band:g} Hz; at least "
                f"{2 * detection_group} are needed with signals.multisine.detection_group {detection_group}"
            )
        rng = np.random.default_rng([seed, 2])
        starts = range(0, len(odd) - detection_group + 1, detection_group)
        left_out = np.array([odd[start + rng.integers(detection_group)] for start in starts])
        lines = np.setdiff1d(odd, left_out)
    elif not len(lines):
        raise InputError(
            f"a multisine of {period:g} s period has no line up to {band:g} Hz: lengthen period_s"
        )
    shape = (lines / lines[0]) ** amplitude_exponent
    amplitudes = shape / np.sqrt(np.sum(shape**2) / 2)
    angles = np.zeros(len(lines)) if phases == "zero" else schroeder_phases(amplitudes)
    if phases == "clipped":
        angles = clipped_phases(lines, amplitudes, angles)
    return Multisine(period, lines, amplitudes, angles, even, left_out)
