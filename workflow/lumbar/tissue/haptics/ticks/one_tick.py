"""One tick: the samples it takes, the forces that act before it, and how all goes over from the tick before, exactly."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, propagation

REACHED = 1e-3
"""Share of a sampling time within which the instant of a sample counts as reached, as in ``tissue_force.h``."""
_NOTHING = 1e-9
"""Share of an interval that is rounding."""
_LONG, _ROWS, _RANK, _WITHIN = 64, 2000, 1e-9, 1e-7
"""From how many values on, and from how many of them, an impulse response is realised by fewer states, to which part of the
largest singular value and of the response."""


def shares(age: float, interval: float, sampling_time: float) -> list[float]:
    """Where on the line from the tick before, 0, to this one, 1, the samples lie that this tick takes.

    Parameters
    ----------
    age : float
        Seconds from the instant of the newest sample to the tick before.
    interval : float
        Seconds from that tick to this one.

    Returns
    -------
    list of float
        Empty where no instant has come.
    """
    count = int((age + interval) / sampling_time + REACHED)
    instants = [sample * sampling_time - age for sample in range(1, count + 1)]
    late = interval - REACHED * sampling_time
    return [instant / interval if instant < late else 1.0 for instant in instants]


States = tuple[np.ndarray, np.ndarray, np.ndarray, float]
"""Matrices A, B, C and D; shapes (n, n), (n,), (n,) and none."""


def realisation(model: SampledModel) -> States:
    """State space of a model at its own samples, without `delay`: of a long impulse response as few states as it has."""
    numerator, denominator = model.numerator / model.denominator[0], model.denominator / model.denominator[0]
    found = _of_impulses(numerator) if len(denominator) == 1 and len(numerator) > _LONG else None
    if found is not None:
        return found
    order = max(len(numerator), len(denominator)) - 1
    numerator, denominator = (np.pad(part, (0, order + 1 - len(part))) for part in (numerator, denominator))
    states = np.eye(order, k=1)
    states[:, :1] = -denominator[1:, None]
    return states, numerator[1:] - denominator[1:] * numerator[0], np.eye(1, order)[0], float(numerator[0])


def _of_impulses(impulse: np.ndarray) -> States | None:
    """By the singular values of the Hankel matrix; None where few states do not give the response back.

    S. Y. Kung, A new identification and model reduction algorithm via singular value decomposition, Proc. 12th Asilomar
    Conference on Circuits, Systems and Computers (1978) 705–714.
    """
    hankel = np.lib.stride_tricks.sliding_window_view(np.pad(impulse[1:], (0, _LONG)), _LONG)[:_ROWS]
    left, sizes, right = np.linalg.svd(hankel, full_matrices=False)
    root = np.sqrt(sizes[sizes > _RANK * sizes[0]])
    observed = left[:, : len(root)] * root
    states = np.linalg.lstsq(observed[:-1], observed[1:])[0]
    start, given = root * right[: len(root), 0], np.empty(len(impulse) - 1)
    state = start
    for sample in range(len(given)):
        given[sample], state = observed[0] @ state, states @ state
    same = np.abs(given - impulse[1:]).sum() <= _WITHIN * np.abs(impulse).sum()
    return (states, start, observed[0], float(impulse[0])) if same else None


def taken_samples(states: States, forces: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """What a tick that takes so many samples makes of the state before it, and of the positions of the samples.

    Parameters
    ----------
    forces : int
        Of so many of the newest ticks that the state holds.

    Returns
    -------
    tuple of numpy.ndarray, of shapes (n, n) and (n, samples)
        The state is that of `PeriodicModel.transitions`.
    """
    a, b, c, d = states
    first = 2 + forces
    kept, by_position = np.eye(first + len(a)), np.zeros((first + len(a), samples))
    kept[3:first, 2:first] = np.eye(forces - 1, forces)
    for sample in range(samples):
        kept[2], by_position[2] = c @ kept[first:], c @ by_position[first:]
        by_position[2, sample] += d
        kept[first:], by_position[first:] = a @ kept[first:], a @ by_position[first:]
        by_position[first:, sample] += b
    return kept, by_position


def acting_forces(interval: float, delay: float, before: Iterable[float]) -> list[tuple[int, float]]:
    """What acts from a tick to the next one: how many ticks old a force is, and for how many seconds; in their order.

    Parameters
    ----------
    delay : float
        Seconds from a tick to its force.
    before : iterable of float
        The intervals before, the newest first, without end.
    """
    found, end, begins = [], interval, delay
    for age, earlier in enumerate(before):
        begin = begins if begins > _NOTHING * interval else 0.0
        if begin < end:
            found.append((age, end - begin))
            end = begin
        if not end:
            break
        begins -= earlier
    return found[::-1]


def tick_transition(
    states: States, device: DeviceSettings, forces: int, acting: list[tuple[int, float]], line: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of one tick what `PeriodicModel.transitions` has of all: from what acts before it and the `shares` of its samples."""
    kept, by_position = taken_samples(states, forces, len(line))
    moved, pushed = np.eye(len(kept)), np.zeros_like(kept)
    for age, seconds in acting:
        transition, by_force = propagation(device, seconds)
        moved[:2], pushed[:2] = transition @ moved[:2], transition @ pushed[:2]
        pushed[:2, 2 + age] -= by_force
    by_readings = by_position @ np.stack([1.0 - line, line], axis=1)
    free = kept @ moved + np.outer(by_readings[:, 1], moved[0])
    free[:, 0] += by_readings[:, 0]
    return free, kept @ pushed + np.outer(by_readings[:, 1], pushed[0]), by_readings
