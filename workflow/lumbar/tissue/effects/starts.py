"""Where the search for an effect's nonlinear parameters begins: frequencies and intervals that the residual shows.

Found at once over all of them; a grid as fine as they need would be slow.
"""

from __future__ import annotations

import numpy as np

from lumbar.tissue.models.motion import Motion

_EDGES = 160
"""Most instants that are tried as ends of an interval."""
_LINES = 3
"""How many of the strongest frequencies are tried."""
_HIGHEST = 4.0
"""Hz; people move no faster."""


def strongest_lines(motion: Motion, residual: np.ndarray) -> list[np.ndarray]:
    """Frequencies (Hz) at which the residual has its strongest lines, strongest first.

    Zero-padded periodogram with a Hann window. Trends (below 1.5 cycles per record) are left out; lines of a model
    error that repeats with a periodic input are left out by keeping away from the input's own strong lines.
    """
    padded = 8 * len(residual)
    window = np.hanning(len(residual))
    frequency = np.fft.rfftfreq(padded, motion.sampling_time)
    power = np.abs(np.fft.rfft((residual - residual.mean()) * window, padded)) ** 2
    excitation = np.abs(np.fft.rfft((motion.position - motion.position.mean()) * window, padded)) ** 2
    resolution = 1.0 / (len(residual) * motion.sampling_time)
    power[frequency < 1.5 * resolution] = 0.0
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    if not len(peaks):
        return [np.array([2 * resolution])]
    # How far a line stands out where the input is weak counts, not its height alone.
    weight = power[peaks] / (1e-3 * excitation.max() + excitation[peaks])
    by_weight = peaks[np.argsort(-weight)[:_LINES]]
    by_power = peaks[np.argsort(-power[peaks])[:1]]
    return [np.array([frequency[peak]]) for peak in dict.fromkeys([*by_weight, *by_power])]


def interval_starts(motion: Motion, residual: np.ndarray, carriers: list[np.ndarray]) -> list[np.ndarray]:
    """Start and stop (s) of the interval in which two carriers explain most of the residual, jointly with the base.

    The base of Eq. 4.1 is refitted for every interval: sums over an interval are differences of cumulative sums.

    The list holds this one pair; residual and both carriers have shape (samples,).
    """
    base = np.stack([motion.acceleration, motion.velocity, np.sin(motion.position)])
    carrier = np.stack(carriers)
    edges = np.linspace(0, len(motion), min(_EDGES, len(motion) // 4) + 1).astype(int)
    cross = _cumulative(base[:, None] * carrier, edges)
    square = _cumulative(carrier[:, None] * carrier, edges)
    right = _cumulative(carrier * residual, edges)
    first, last = np.triu_indices(len(edges), k=2)
    cross, square, right = (item[..., last] - item[..., first] for item in (cross, square, right))
    inverse = np.linalg.pinv(base @ base.T, hermitian=True)
    square = square - np.einsum("abn,ac,cdn->bdn", cross, inverse, cross)
    right = right - np.einsum("abn,ac,c->bn", cross, inverse, base @ residual)
    determinant = square[0, 0] * square[1, 1] - square[0, 1] ** 2
    gain = (
        square[1, 1] * right[0] ** 2 - 2 * square[0, 1] * right[0] * right[1] + square[0, 0] * right[1] ** 2
    )
    # An interval that is all but the whole record leaves the base nothing to differ from.
    sound = determinant > 1e-6 * square[0, 0] * square[1, 1]
    gain = np.where(sound, gain / np.where(sound, determinant, 1.0), 0.0)
    best = int(gain.argmax())
    times = edges[[first[best], last[best]]] * motion.sampling_time
    return [np.maximum(times, motion.sampling_time)]


def _cumulative(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Sum up to every edge over the last axis."""
    total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
    return total[..., edges]


def modulation_starts(motion: Motion, residual: np.ndarray, carriers: list[np.ndarray]) -> list[np.ndarray]:
    """Frequencies (Hz) at which the residual holds a carrier that swells and fades, strongest first.

    Peaks of the spectrum of residual times carrier (the correlation with the modulated carrier), with a Hann window and
    zero-padding; below one and a half cycles per record a modulation is no oscillation.
    """
    padded = 8 * len(residual)
    window = np.hanning(len(residual))
    frequency = np.fft.rfftfreq(padded, motion.sampling_time)
    lowest = 1.5 / (len(residual) * motion.sampling_time)
    found = []
    for carrier in carriers:
        product = residual * carrier
        power = np.abs(np.fft.rfft((product - product.mean()) * window, padded)) ** 2
        peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
        peaks = peaks[(frequency[peaks] >= lowest) & (frequency[peaks] <= _HIGHEST)]
        found += list(frequency[peaks[np.argsort(-power[peaks])[:_LINES]]])
    return [np.array([value]) for value in dict.fromkeys(found)] or [np.array([2 * lowest])]
