"""A tool that pushes into the tissue, rests and withdraws: what a user of the FMUs feels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lumbar.tissue.fmu.build.description import FMI_VERSIONS
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.package import fmu_name
from lumbar.tissue.fmu.build.reference_response import push_depth, push_profile
from lumbar.tissue.fmu.check.fmu_check import simulate_fmu


@dataclass(frozen=True)
class Push:
    """Outputs of all FMUs to the same movement."""

    time: np.ndarray
    """Shape (samples,): seconds."""
    inputs: np.ndarray
    """Shape (samples,)."""
    outputs: dict[tuple[str, str], np.ndarray]
    """Dict of tuple (str, str) to numpy.ndarray, each of shape (samples,): by model and FMI version."""

    def most_delayed(self) -> str:
        """Model whose FMI 2.0 output differs most from that of FMI 3.0."""
        names = dict.fromkeys(name for name, _ in self.outputs)
        return max(
            names, key=lambda name: np.abs(self.outputs[name, "2.0"] - self.outputs[name, "3.0"]).max()
        )


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
    time, profile = push_profile(models[0].sampling_time)
    depth = min(push_depth(model, profile) for model in models)
    outputs = {
        (model.name, version): simulate_fmu(
            folder / fmu_name(model.name, version), time, model.input.offset + depth * profile
        )
        for model in models
        for version in FMI_VERSIONS
    }
    return Push(time, depth * profile, outputs)
