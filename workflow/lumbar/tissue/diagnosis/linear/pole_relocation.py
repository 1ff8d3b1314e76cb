"""Poles of a linear model from its input and output without a start: relocation of poles (vector fitting).

Steiglitz and McBride's iteration in partial fractions, which stays well conditioned where all poles are slow beside the
sampling (Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052-1061; in the time domain Grivet-Talocia, IEEE
Trans. Circuits Syst. I 50 (2003) 1444-1456).
"""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.linear.poles import Poles, forces
from lumbar.tissue.models.joined_motions import JoinedMotions

_ITERATIONS = 6
_DAMPING = 0.3
"""Damping ratio of the starting pairs of poles."""


def relocated_poles(data: FitData, order: int, low: float, high: float, held: bool) -> list[Poles]:
    """Poles after each iteration from pairs spread evenly over a band.

    Parameters
    ----------
    order : int
        Number of poles.
    low, high : float
        Band of the starting poles in 1/s.
    held : bool
        Whether the input is held between jumps.

    Returns
    -------
    list of Poles
        The last iteration last.
    """
    poles, found = _starting_poles(order, low, high), []
    for _ in range(_ITERATIONS):
        poles = np.clip(np.abs(poles), 1e-2 * low, 1e2 * high) * np.exp(1j * np.angle(poles))
        shaped = Poles.of(poles)
        poles = _relocated(data, shaped, held)
        if not np.isfinite(poles).all():
            break
        found.append(Poles.of(poles))
    return found


def _starting_poles(order: int, low: float, high: float) -> np.ndarray:
    sizes = np.geomspace(low, high, order // 2 + order % 2 + 2)[1:-1]
    pairs = sizes[order % 2 :] * np.exp(1j * (np.pi - np.arccos(_DAMPING)))
    return np.concatenate([-sizes[: order % 2], pairs, pairs.conj()])


def _relocated(data: FitData, poles: Poles, held: bool) -> np.ndarray:
    """Zeros of σ = 1 + Σ kᵢ/(s − pᵢ) such that σ F is a numerator over the same poles."""
    state, inputs = _real_form(poles)
    filtered = _filtered_forces(data, poles)
    columns = np.column_stack([forces(data.motion, poles, held), filtered])
    columns = data.counted(columns)
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0] = 1.0
    solution = np.linalg.lstsq(columns / size, data.counted(data.force), rcond=1e-9)[0] / size
    gains = -solution[-poles.order :]
    return np.linalg.eigvals(state - np.outer(inputs, gains))


def _real_form(poles: Poles) -> tuple[np.ndarray, np.ndarray]:
    """State matrix and input vector whose states are the responses that `_filtered_forces` gives."""
    order = poles.order
    state, inputs = np.zeros((order, order)), np.zeros(order)
    for index, (damping, square) in enumerate(poles.sections):
        at = 2 * index
        state[at, at + 1], state[at + 1, at], state[at + 1, at + 1] = 1.0, -square, -damping
        inputs[at + 1] = 1.0
    for index, rate in enumerate(poles.rates, start=2 * len(poles.sections)):
        state[index, index], inputs[index] = -rate, 1.0
    return state, inputs


def _filtered_forces(data: FitData, poles: Poles) -> np.ndarray:
    """Force through the state equations of `_real_form`, taken as linear between samples, shape (samples, order)."""
    from scipy.signal import cont2discrete, lfilter

    parts = data.motion.split(data.force) if isinstance(data.motion, JoinedMotions) else [data.force]
    transfers = []
    for damping, square in poles.sections:
        transfers += [([1.0], [1.0, damping, square]), ([1.0, 0.0], [1.0, damping, square])]
    transfers += [([1.0], [1.0, rate]) for rate in poles.rates]
    columns = []
    for transfer in transfers:
        (numerator,), denominator, _ = cont2discrete(transfer, data.motion.sampling_time, method="foh")
        columns.append(np.concatenate([lfilter(numerator, denominator, part - part[0]) for part in parts]))
    return np.column_stack(columns)
