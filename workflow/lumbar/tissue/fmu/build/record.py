"""The record of an FMU: the model as it was identified and how it is run, from which all else in the file follows."""

import json
from dataclasses import fields

from lumbar import __version__
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.models.fitted_model import models_document

_OF_THE_STUDY = {
    *("models", "trained_on", "estimator", "unstable"),
    *("targets", "compiler_cache", "check_samples", "device"),
}
"""Settings that choose, build or judge models: how one is run is what all others say."""


def record_text(model: ExportModel, data: str) -> str:
    """Return the record: a file of models that holds this one, the settings that shape the FMU, and what wrote it."""
    run = {item.name: getattr(model.settings, item.name) for item in fields(model.settings)}
    content = {
        **models_document([model.identified], data),
        "runtime": {name: value for name, value in run.items() if name not in _OF_THE_STUDY},
        "on_device": list(model.on_device),
        "written_by": f"lumbar {__version__}",
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
