"""A tool that pushes into the tissue, rests and withdraws: what a user of the FMUs feels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.runtime.check import simulate_fmu
from lumbar.runtime.description import FMI_VERSIONS
from lumbar.runtime.export_model import ExportModel
from lumbar.runtime.package import fmu_name

_SHARE_OF_LIMIT = 0.5
_DURATIONS = {"rest": 0.1, "push": 0.25, "hold": 0.4, "withdraw": 0.25, "end": 0.3}
"""Seconds."""


@dataclass(frozen=True)
class Push:
    """Outputs of all FMUs to the same movement.

    Attributes
    ----------
    time : numpy.ndarray, shape (samples,)
        Seconds.
    inputs : numpy.ndarray, shape (samples,)
    outputs : dict of tuple (str, str) to numpy.ndarray, each of shape (samples,)
        By model and FMI version.
    """

    time: np.ndarray
    inputs: np.ndarray
    outputs: dict[tuple[str, str], np.ndarray]

    def most_delayed(self) -> str:
        """Model whose FMI 2.0 output differs most from that of FMI 3.0."""
        names = dict.fromkeys(name for name, _ in self.outputs)
        return max(
            names, key=lambda name: np.abs(self.outputs[name, "2.0"] - self.outputs[name, "3.0"]).max()
        )


def push_profile(sampling_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return time and a movement from 0 to 1 and back, with flanks of half a cosine.

    Parameters
    ----------
    sampling_time : float
        Seconds.

    Returns
    -------
    tuple of numpy.ndarray, each of shape (samples,)
    """
    ends = np.cumsum(list(_DURATIONS.values()))
    time = np.arange(round(ends[-1] / sampling_time) + 1) * sampling_time
    rise = np.clip((time - ends[0]) / _DURATIONS["push"], 0.0, 1.0)
    fall = np.clip((time - ends[2]) / _DURATIONS["withdraw"], 0.0, 1.0)
    return time, (np.cos(np.pi * fall) - np.cos(np.pi * rise)) / 2


def push(models: list[ExportModel], folder: Path) -> Push:
    """Play one push through the FMUs of all models.

    The depth is chosen such that the stiffest model reaches half of its output limit.

    Parameters
    ----------
    models : list of ExportModel
        At least one, all with the same input and sampling time.
    folder : Path
        Where the FMUs lie.
    """
    from scipy.signal import lfilter

    time, profile = push_profile(models[0].sampling_time)
    peaks = [np.abs(lfilter(model.numerator, model.denominator, profile)).max() for model in models]
    depth = _SHARE_OF_LIMIT * models[0].output_limit / (max(peaks) or 1.0)
    outputs = {
        (model.name, version): simulate_fmu(
            folder / fmu_name(model.name, version), time, model.input.offset + depth * profile
        )
        for model in models
        for version in FMI_VERSIONS
    }
    return Push(time, depth * profile, outputs)
