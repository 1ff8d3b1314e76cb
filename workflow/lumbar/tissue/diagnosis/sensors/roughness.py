"""What of a position lies beyond its excitation's band: noise, the steps of a converter, or a clock that jitters.

Noise is there whether the tool moves or not. A sample taken δ too early or late is off by speed times δ. So the variance of
what lies beyond the band is, at speed v, σ² + τ² v², with σ of the noise and τ of the jitter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.sensors.excitation_band import edge_above_floor, within_band

_BINS = 24
_MAD = 1.4826
"""Standard deviation of normal values over their median size."""
_EFFICIENCY = 0.37
"""Of that estimate: how much of the samples it uses."""
_LEAST = 2e-5
"""Least noise that is looked at, in standard deviations of the position."""
_MATTERS = 0.03
"""Least noise that matters, through stiffness and damping, in the noise of the force."""
_MATTERS_ANYHOW = 1e-3
"""Noise that matters to what turns with the speed, in standard deviations of the position."""
_CONCENTRATED = 4.0
"""RMS over the standard deviation by medians, from which on what is left is corners of the motion and no noise."""
_SURE = 20.0
"""Log-likelihood ratio from which on one of noise and jitter alone is not enough."""
_PART = 0.1
"""Least share of the variance beyond the band of something that is told."""


@dataclass(frozen=True, eq=False)
class Roughness:
    """What lies beyond the band of a position."""

    edge: float
    """Hz."""
    smooth: np.ndarray
    rough: np.ndarray
    speed: np.ndarray
    answer: np.ndarray
    """`smooth`, `rough`, `speed`, `answer`: shape (samples,): the position within its band, the rest of it, the speed (per
    second), and the force beyond that band."""
    noise: float
    """σ, in the position's unit, over the whole of the spectrum; 0 where the jitter is enough."""
    jitter: float
    """τ, in seconds RMS; 0 where the noise is enough."""

    @property
    def moves(self) -> float:
        """RMS of what noise and jitter do to the position."""
        return float(np.hypot(self.noise, self.jitter * np.sqrt(np.mean(self.speed**2))))


def roughness_of(record: Record) -> Roughness | None:
    """Split a position at the edge of its band; None where nothing is left beyond it that matters and is rough all along."""
    values, step = record["input"], record.sampling_time
    edge = edge_above_floor(values, step)
    if edge is None:
        return None
    smooth = within_band(values, step, edge)
    rough, speed = values - smooth, np.gradient(smooth, step)
    usual = _spread(rough)
    if usual <= _LEAST * np.std(values) or np.sqrt(np.mean(rough**2)) > _CONCENTRATED * usual:
        return None
    noise, jitter = _noise_and_jitter(rough, speed, step, edge)
    answer = record["output"] - within_band(record["output"], step, edge)
    found = Roughness(edge, smooth, rough, speed, answer, noise, jitter)
    return found if _matters(found, record) else None


def _spread(values: np.ndarray) -> float:
    return _MAD * float(np.median(np.abs(values)))


def _noise_and_jitter(rough: np.ndarray, speed: np.ndarray, step: float, edge: float) -> tuple[float, float]:
    """σ and τ of Var r[n] = Σₖ g[k]² (σ² + τ² v[n−k]²), with g the filter that left r; one is 0 where the other is enough."""
    from scipy.signal import fftconvolve

    taps = _response_beyond(step, edge) ** 2
    share, power = float(taps.sum()), np.maximum(fftconvolve(speed**2, taps, "same"), 0.0)
    order = np.argsort(power)
    groups = [group for group in np.array_split(order, _BINS) if group.size]
    found = np.array([_spread(rough[group]) ** 2 for group in groups])
    found = np.maximum(found, 1e-12 * found.max())
    moved = np.array([power[group].mean() for group in groups])
    weight = 0.5 * share * _EFFICIENCY * len(rough) / len(groups)
    bases = {"both": np.column_stack([np.full(len(moved), share), moved])}
    bases["noise"], bases["jitter"] = bases["both"] * [1, 0], bases["both"] * [0, 1]
    fits = {name: _variances(columns, found) for name, columns in bases.items()}
    loss = {name: weight * _deviance(bases[name] @ fits[name], found) for name in fits}
    sure = {name: loss[name] - loss["both"] > _SURE for name in ("noise", "jitter")}
    alone = min(("noise", "jitter"), key=loss.get)
    parts = fits["both"] * bases["both"].mean(axis=0)
    both = sure["noise"] and sure["jitter"] and parts.min() > _PART * parts.sum()
    noise, jitter = np.sqrt(fits["both" if both else alone])
    return float(noise), float(jitter)


def _variances(columns: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Not negative coefficients of variances, each weighed by what it is expected to be."""
    from scipy.optimize import nnls

    expected, fitted = found, np.zeros(columns.shape[1])
    for _ in range(8):
        fitted = nnls(columns / expected[:, None], found / expected)[0]
        expected = np.maximum(columns @ fitted, 1e-6 * found.max())
    return fitted


def _deviance(expected: np.ndarray, found: np.ndarray) -> float:
    """Of variances: Σ s²/σ² − 1 − ln s²/σ²."""
    ratio = found / np.maximum(expected, 1e-6 * found.max())
    return float(np.sum(ratio - 1 - np.log(ratio)))


def _response_beyond(step: float, edge: float) -> np.ndarray:
    """Impulse response of what leaves only what lies beyond the edge."""
    reach = int(8 / (edge * step)) + 8
    impulse = np.zeros(4 * reach + 1)
    impulse[2 * reach] = 1.0
    response = impulse - within_band(impulse, step, edge)
    return response[reach : 3 * reach + 1]


def _matters(found: Roughness, record: Record) -> bool:
    """Whether noise or jitter moves a modelled force by a part of the force's own noise, or is large beside the motion."""
    if found.moves > _MATTERS_ANYHOW * np.std(found.smooth):
        return True
    force, step = record["output"], record.sampling_time
    share = float(np.sum(_response_beyond(step, found.edge) ** 2))
    return _gain_at_edge(found, force) * found.moves > _MATTERS * _spread(found.answer) / np.sqrt(share)


def _gain_at_edge(found: Roughness, force: np.ndarray) -> float:
    """Size of stiffness and damping at the edge of the band, force over position."""
    columns = np.column_stack([np.ones(len(force)), found.smooth, found.speed])
    _, stiffness, damping = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.hypot(stiffness, 2 * np.pi * found.edge * damping))


def is_motion(found: Roughness, record: Record) -> bool:
    """Whether the force follows what lies beyond the band: then the tool moves so, and no sensor is at fault.

    Samples at low speed are looked at, where a clock that jitters does not make both channels deviate alike.
    """
    force, step = record["output"], record.sampling_time
    slow = np.abs(found.speed) <= np.median(np.abs(found.speed))
    columns = np.column_stack([found.rough, np.gradient(found.rough, step)])[slow]
    fitted = columns @ np.linalg.lstsq(columns, found.answer[slow], rcond=None)[0]
    explained, left = np.sum(fitted**2), np.sum((found.answer[slow] - fitted) ** 2)
    expected = _gain_at_edge(found, force) ** 2 * np.sum(columns[:, 0] ** 2)
    return bool(explained > 25.0 * left / slow.sum() and explained > 0.25 * expected)
