"""The response that an FMU should give, computed in Python, and the movement that it is played with."""

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import guard_forces, shortened
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.conventions import along_axes
from lumbar.tissue.models.transfer_function import filtered

_LARGEST_GROWTH = 1e6
"""An unstable model is simulated until it has grown by this factor."""
_HALVINGS = 60
_SHARE_OF_LIMIT = 0.5
MAX_EMBEDDED = 250
"""Samples of a reference signal: more would make an FMU for 1 kHz larger than its libraries need."""
_DURATIONS = {"rest": 0.1, "push": 0.25, "hold": 0.4, "withdraw": 0.25, "end": 0.3}
"""Seconds."""


def moving_average(deviations: np.ndarray, samples: int, at_rest: bool = False) -> np.ndarray:
    """Return the moving average over the newest samples, from rest at 0 or at the first sample."""
    if deviations.ndim > 1:
        return np.stack([moving_average(along, samples, at_rest) for along in deviations.T], axis=1)
    first = deviations[0] if at_rest else 0.0
    return first + filtered([1 / samples] * samples, [1.0], deviations - first)


def model_output(model: ExportModel, inputs: np.ndarray, late: bool = False) -> np.ndarray:
    """Return the output of model and moving average, in deviations from rest; shape (samples,).

    Parameters
    ----------
    inputs : numpy.ndarray, shape (samples,), in space (samples, axes)
        In the input's unit.
    late : bool
        As a client without event mode reads it.
    """
    dynamics, at_rest = model.dynamics, model.starts_at_rest
    deviations = inputs - model.rest
    if model.guards.contact:
        deviations = np.where(deviations < 0, 0.0, deviations)
    averaged = moving_average(deviations, model.moving_average, at_rest)
    respond = dynamics.late_response if late else dynamics.response
    if at_rest and isinstance(dynamics, LinearModel):
        return dynamics.rest_gain * averaged[0] + respond(averaged - averaged[0])
    return respond(averaged)  # effects begin at rest at any input


def reference_output(model: ExportModel, inputs: np.ndarray, version: str) -> np.ndarray:
    """Return the output computed in Python, as a client of this FMI version should read it, shape (samples,).

    Parameters
    ----------
    inputs : numpy.ndarray, shape (samples,)
    version : str
        In FMI 2.0 the feed-through is one sample late, or the whole force; not so at the start, but with guards the force
        is 0 there.

    Raises
    ------
    NumericalError
        If the output overflows.
    """
    late = version == "2.0"
    outputs = model_output(model, inputs, late and not model.guards.active) + model.output.offset
    if not np.isfinite(outputs).all():
        raise NumericalError(f"{model.name}: the output overflows within {len(inputs)} samples")
    if model.guards.contact:
        outputs = np.where(model.resistance * outputs < 0, 0.0, outputs)
    limited = shortened(outputs, model.output_limit)
    return guard_forces(model, inputs, limited, event_mode=not late) if model.guards.active else limited


def samples_within_range(model: ExportModel, samples: int) -> int:
    """Return `samples`, or fewer if an unstable model would outgrow double precision."""
    pole = model.dynamics.largest_pole
    return samples if pole <= 1.0 else max(3, min(samples, int(np.log(_LARGEST_GROWTH) / np.log(pole))))


def scale_to(model: ExportModel, inputs: np.ndarray, output: float) -> float:
    """Return the factor on deviations of the input at which the largest output is `output`.

    A model with effects is not linear: its factor is halved until the output fits.
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
            pass  # too large a motion; the next one is half of it
        scale /= 2.0
    return scale


def push_profile(sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time in seconds and a movement from 0 to 1 and back, with flanks of half a cosine, each of shape (samples,)."""
    ends = np.cumsum(list(_DURATIONS.values()))
    time = np.arange(round(ends[-1] / sampling_time) + 1) * sampling_time
    rise = np.clip((time - ends[0]) / _DURATIONS["push"], 0.0, 1.0)
    fall = np.clip((time - ends[2]) / _DURATIONS["withdraw"], 0.0, 1.0)
    return time, (np.cos(np.pi * fall) - np.cos(np.pi * rise)) / 2


def push_depth(model: ExportModel, profile: np.ndarray) -> float:
    """Return the depth of a push at which the model's force is half of its limit."""
    return scale_to(model, along_axes(profile, len(model.axes)), _SHARE_OF_LIMIT * model.output_limit)
