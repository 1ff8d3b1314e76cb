"""Models under the reader's hand: the C code of their FMUs as WebAssembly, in the page itself."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lumbar.base.errors import LumbarError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.fmu.build.compiler import cache_folder
from lumbar.tissue.fmu.build.description import model_description
from lumbar.tissue.fmu.build.export_model import ExportModel, export_models
from lumbar.tissue.fmu.build.package import compile_model
from lumbar.tissue.models.fitted_model import FittedModel

TARGET = "wasm32-wasi"
RATE_HZ = 1000.0
"""At which the models sample the hand's position, as a haptic loop does."""
_UNLIMITED = 1e9
"""Largest output, in its unit: no device is there that would have to be spared."""


def pushed_models(models: Sequence[FittedModel], compiler_cache: str | None, data: str) -> dict[str, Any]:
    """Return what the page's script plays: libraries and descriptions of the models, and how far the hand may go.

    ``remark`` says why there is no model where one cannot be an FMU or no compiler is installed.

    Parameters
    ----------
    models : sequence of FittedModel
        Base first; the handle moves within the motion that it was fitted to.
    compiler_cache : str, optional
        As `RuntimeSettings.compiler_cache`. Limits and guards are those of a device, which is not here.
    """
    bare = RuntimeSettings(
        rate_Hz=max(RATE_HZ, 1 / models[0].sampling_time),
        moving_average_ms=0.0,
        output_limit=_UNLIMITED,
        unstable="export",
    )
    try:
        exported = export_models(list(models), bare)
        played = [_played(model, cache_folder(compiler_cache), data) for model in exported]
    except LumbarError as error:
        return {"models": [], "remark": str(error)}
    first = models[0]
    return {
        "models": played,
        "remark": "",
        "moved": first.input.label,
        "answer": first.output.label,
        "unit": first.output.unit,
        "rest": first.input.offset,
        "lowest": first.valid_for.lowest,
        "highest": first.valid_for.highest,
        "range": first.valid_for.in_words(first.input.unit),
        "rate_Hz": bare.rate_Hz,
    }


def _played(model: ExportModel, cache: Path, data: str) -> dict[str, str]:
    library = compile_model(model, [TARGET], cache)[TARGET]
    return {
        "label": model.name.replace("_", " "),
        "library": base64.b64encode(library).decode("ascii"),
        "description": model_description(model, "3.0", data),
    }
