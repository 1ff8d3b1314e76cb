"""The test motion of an FMU and its reference response, computed in Python with the guards of the force."""

import math

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.conventions import along_axes
from lumbar.tissue.models.transfer_function import filtered

_MAX_GROWTH = 1e6
"""An unstable model is simulated until it has grown by this factor."""
_HALVINGS = 60
_PUSH_OUTPUT_SHARE = 0.5
"""Largest output of a push as a share of its limit."""
MAX_EMBEDDED = 250
"""Largest number of samples of a reference signal: more would make the FMU larger than its libraries."""
_DURATIONS_S = {"rest": 0.1, "push": 0.25, "hold": 0.4, "withdraw": 0.25, "end": 0.3}


def moving_average(deviations: np.ndarray, samples: int, at_rest: bool = False) -> np.ndarray:
    """Return the moving average over the newest samples, from rest at 0 or at the first sample."""
    if deviations.ndim > 1:
        return np.stack([moving_average(along, samples, at_rest) for along in deviations.T], axis=1)
    first = deviations[0] if at_rest else 0.0
    return first + filtered([1 / samples] * samples, [1.0], deviations - first)


def reference_output(model: ExportModel, inputs: np.ndarray, version: str) -> np.ndarray:
    """Return the output that a client of an FMI version should read, in the shape of `inputs`.

    Parameters
    ----------
    model : ExportModel
        Model; its guards limit the force.
    inputs : numpy.ndarray, shape (samples,), in space (samples, axes)
        Positions in the input's unit.
    version : str
        Version of FMI. In FMI 2.0 the feed-through (with guards the whole force) is one sample late. The first sample is not
        late without guards; with guards its force is 0.

    Raises
    ------
    NumericalError
        If the output overflows.
    """
    dynamics, guards, at_rest = model.dynamics, model.guards, model.starts_at_rest
    deviations = inputs - model.rest
    if guards.contact:
        deviations = np.where(deviations < 0, 0.0, deviations)
    averaged = moving_average(deviations, model.moving_average, at_rest)
    late = version == "2.0"
    if at_rest and isinstance(dynamics, LinearModel):  # effects begin at rest at any input
        gain = sum(dynamics.numerator) / sum(dynamics.denominator)
        response = dynamics.response(averaged - averaged[0], late and not guards.active)
        outputs = gain * averaged[0] + response + model.output.offset
    else:
        outputs = dynamics.response(averaged, late and not guards.active) + model.output.offset
    if not np.isfinite(outputs).all():
        raise NumericalError(f"{model.name}: the output overflows within {len(inputs)} samples")
    if guards.contact:
        outputs = np.where(model.resistance * outputs < 0, 0.0, outputs)
    limited = limit_size(outputs, model.output_limit)
    return _guard_forces(model, inputs, limited, event_mode=not late) if guards.active else limited


def limit_size(vectors: np.ndarray, size: float) -> np.ndarray:
    """Return forces limited to a size, shape (samples,); in space, (samples, axes), long vectors are shortened."""
    if vectors.ndim == 1:
        return np.clip(vectors, -size, size)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > size, vectors / np.where(length > size, length, 1.0) * size, vectors)


def _guard_forces(
    model: ExportModel, positions: np.ndarray, limited: np.ndarray, event_mode: bool
) -> np.ndarray:
    """Return the forces after rate limit and passivity guard, with the operations of ``sampled_force.c``.

    The energy is observed as B. Hannaford and J.-H. Ryu do (IEEE Trans. Robotics and Automation 18 (2002) 1-10). A force f that
    is held for a sample T releases f d over the displacement d, and a damping b receives at least b d²/T meanwhile (Cauchy and
    Schwarz); the least sum is −f² T/(4 b): forces within √(4 b E/T) can never release more than the available energy E. Without
    event mode a force may be displayed immediately or one sample later: both cases are counted. `limited` are the forces within
    their limit and, with contact, without pulls.
    """
    guards, step, unit = model.guards, model.sampling_time, model.units
    worst = step / (4.0 * guards.device_damping) if guards.passive else math.inf
    energy = late = 0.0
    path, wanted = (values.reshape(len(values), -1).tolist() for values in (positions, limited))
    shown = earlier = [0.0] * len(path[0])
    forces = []
    last = path[0]
    for position, force in zip(path, wanted, strict=True):
        if forces:
            moved = [(now - before) * unit.position for now, before in zip(position, last, strict=True)]
            damped = _dot([guards.device_damping * part for part in moved], moved) / step
            work = [
                model.resistance * _dot([part * unit.force for part in acting], moved) + damped
                for acting in (shown, earlier)
            ]
            energy = min(energy + work[0], guards.energy_reserve)
            late = energy if event_mode else min(late + work[1], guards.energy_reserve)
        if guards.rate_limit > 0:
            force = _nearest(force, shown, guards.rate_limit * step)
        if guards.passive:
            first = [part * unit.force for part in shown]
            available = energy if event_mode else min(energy, late - _dot(first, first) * worst)
            largest = math.sqrt(available / worst) / unit.force if available > 0 else 0.0
            force = _nearest(force, [0.0] * len(force), largest)
        earlier, shown, last = shown, force, position
        forces.append(force)
    read = forces if event_mode else [[0.0] * len(shown), *forces[:-1]]
    return np.array(read).reshape(limited.shape)


def _dot(one: list[float], other: list[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _nearest(wanted: list[float], centre: list[float], distance: float) -> list[float]:
    """Return the wanted force, or the force at `distance` from `centre` towards it if it is farther away."""
    if len(wanted) == 1:
        low, high = (centre[0] - distance, centre[0] + distance) if centre[0] else (-distance, distance)
        return [low if wanted[0] < low else high if wanted[0] > high else wanted[0]]
    away = [a - b for a, b in zip(wanted, centre, strict=True)]
    length = math.hypot(*away)
    if length <= distance:
        return wanted
    return [b + a / length * distance for a, b in zip(away, centre, strict=True)]


def samples_within_range(model: ExportModel, samples: int) -> int:
    """Return `samples`, or a smaller number if an unstable model would overflow."""
    pole = model.dynamics.largest_pole
    return samples if pole <= 1.0 else max(3, min(samples, int(np.log(_MAX_GROWTH) / np.log(pole))))


def scale_to(model: ExportModel, inputs: np.ndarray, output: float) -> float:
    """Return the factor on deviations of the input at which the largest output is `output`.

    A model with effects is not linear: its factor is halved until the output is at most `output`.
    """
    if isinstance(model.dynamics, LinearModel):
        largest = np.abs(model.dynamics.response(inputs)).max()
        return output / largest if np.isfinite(largest) and largest > 0 and output > 0 else 1.0
    scale = output / max(np.abs(inputs).max(), np.finfo(float).tiny)
    for _ in range(_HALVINGS):
        try:
            if np.abs(model.dynamics.response(scale * inputs)).max() <= output:
                break
        except NumericalError:
            pass  # the motion is too large; the next one is half of it
        scale /= 2.0
    return scale


def push_profile(sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time in seconds and a push from 0 to 1 and back, with half-cosine flanks, each of shape (samples,)."""
    ends = np.cumsum(list(_DURATIONS_S.values()))
    time = np.arange(round(ends[-1] / sampling_time) + 1) * sampling_time
    rise = np.clip((time - ends[0]) / _DURATIONS_S["push"], 0.0, 1.0)
    fall = np.clip((time - ends[2]) / _DURATIONS_S["withdraw"], 0.0, 1.0)
    return time, (np.cos(np.pi * fall) - np.cos(np.pi * rise)) / 2


def push_depth(model: ExportModel, profile: np.ndarray) -> float:
    """Return the depth of a push at which the model's largest force is half of its limit."""
    return scale_to(model, along_axes(profile, len(model.axes)), _PUSH_OUTPUT_SHARE * model.output_limit)
