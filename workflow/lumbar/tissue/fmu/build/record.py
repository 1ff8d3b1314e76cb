"""The record of an FMU: the model as it was identified and how it is run, from which all else in the file follows."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import cache
from typing import TYPE_CHECKING

from lumbar import __version__
from lumbar.base.errors import Problems
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.effects.catalogue import with_carried
from lumbar.tissue.fmu.build.export_model import ExportModel, export_models
from lumbar.tissue.fmu.conventions import RECORD
from lumbar.tissue.models.fitted_model import models_document, read_models
from lumbar.tissue.models.model_entry import Catalogues

if TYPE_CHECKING:
    from pydantic import TypeAdapter

_OF_THE_STUDY = {
    *("models", "trained_on", "estimator", "unstable"),
    *("targets", "compiler_cache", "check_samples", "device"),
}
"""Settings that choose, build or judge models: how one is run is what all others say."""


def record_text(model: ExportModel, data: str, pictures: list[str]) -> str:
    """Return the record: a file of models that holds this one, the settings that shape the FMU, and what wrote it.

    Parameters
    ----------
    pictures : list of str
        Checksums of what the documentation draws: another release of Matplotlib draws the same in other words.
    """
    run = {item.name: getattr(model.settings, item.name) for item in fields(model.settings)}
    content = {
        **models_document([model.identified], data),
        "runtime": {name: value for name, value in run.items() if name not in _OF_THE_STUDY},
        "on_device": list(model.on_device),
        "pictures": pictures,
        "written_by": f"lumbar {__version__}",
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read_record(content: object, catalogues: Catalogues) -> tuple[ExportModel, str, list[str]]:
    """Return the model of a record, ready for export, the words on its data, and the checksums of its pictures.

    Raises
    ------
    InputError
        With the place of everything that is missing, unknown or not allowed.
    """
    from pydantic import ValidationError

    (identified, *more), problems = read_models(content, with_carried(catalogues, content)), Problems(RECORD)
    assert isinstance(content, dict)  # else it has no models
    data = content.get("data")
    if more:
        problems.add("models", f"{1 + len(more)} models", "an FMU has one")
    if not isinstance(data, str):
        problems.add("data", repr(data), "words are needed")
    for key in ("on_device", "pictures"):
        given = content.get(key)
        if not (isinstance(given, list) and all(isinstance(item, str) for item in given)):
            problems.add(key, repr(given), "a list of texts is needed")
    try:
        settings = _settings().validate_python(content.get("runtime"))
    except ValidationError as error:
        for found in error.errors(include_url=False):
            problems.add(".".join(["runtime", *map(str, found["loc"])]), repr(found["input"]), found["msg"])
    problems.raise_if_any()
    (model,) = export_models([identified], replace(settings, unstable="export"))
    return replace(model, on_device=tuple(content["on_device"])), str(data), content["pictures"]


@cache
def _settings() -> TypeAdapter:
    from pydantic import TypeAdapter

    return TypeAdapter(RuntimeSettings)
