"""Forces that are held from sample to sample, as a hand meets them, and what rate, moving average and delay change of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel, export_models
from lumbar.tissue.fmu.build.reference_response import model_output, push_depth, push_profile
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.perception.felt import Felt, force_difference
from lumbar.tissue.perception.thresholds import Hands

FINEST_HZ = 1000.0
"""Rate at which a hand is taken to meet forces, and that other rates are felt against."""
WITHIN = 1e-3
"""Share of a sample within which an instant counts as reached, as in ``sampled_force.c``."""


def held_force(
    model: ExportModel, time: np.ndarray, position: np.ndarray, delay: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Force and position at the instants of `FINEST_HZ`, each of shape (instants,).

    Parameters
    ----------
    time, position : numpy.ndarray, shape (samples,)
        Seconds from 0 on, and the motion in the model's unit, on straight lines in between.
    delay : float
        Seconds from a sample to its force.
    """
    instants = np.arange(0.0, time[-1] * (1 + 1e-9), 1.0 / FINEST_HZ)
    own, read_at = held_samples(time, position, model.sampling_time, instants - delay)
    force = model_output(model, own) + model.output.offset
    return force[read_at], np.interp(instants, time, position)


def held_samples(
    time: np.ndarray, position: np.ndarray, sampling_time: float, instants: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions at a file's samples, and the sample whose force is held at each instant, shape (instants,)."""
    read_at = np.floor(instants / sampling_time + WITHIN).astype(int).clip(min=0)
    return np.interp(np.arange(read_at[-1] + 1) * sampling_time, time, position), read_at


def felt_on_device(
    model: ExportModel, fitted: FittedModel | None, settings: RuntimeSettings, hands: Hands
) -> Felt | None:
    """What rate, moving average and the device's delay change to a hand over the reference push.

    Against the same model at `FINEST_HZ` with none of them; None where it has no counterpart there, or its output is no force.
    """
    if fitted is None or model.axes:
        return None
    plain = replace(fitted, name=fitted.name.removesuffix(AS_IN_THESIS))
    prompt = replace(
        settings, rate_Hz=FINEST_HZ, moving_average_ms=0.0, device_damping=None, unstable="export"
    )
    time, profile = push_profile(1.0 / FINEST_HZ)
    position = model.input.offset + push_depth(model, profile) * profile
    try:
        ideal, _ = held_force(export_models([plain], prompt)[0], time, position)
        played, position = held_force(model, time, position, 1e-3 * settings.device.delay_ms)
    except (InputError, NumericalError):
        return None
    if not (np.isfinite(ideal).all() and np.isfinite(played).all()):
        return None
    met = force_difference(ideal, played, model.output.unit, position, 1.0 / FINEST_HZ, hands)
    return met and met.felt
