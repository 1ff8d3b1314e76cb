"""The files ``models.json`` and ``refined.json``: fitted models in one schema, checked whole when they are read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lumbar.base.errors import Problems
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_entry import checked_entry

SCHEMA = "lumbar.models/2"


def models_document(models: Iterable[FittedModel], data: str, noise_floor_rms: float | None = None) -> dict:
    """Return the content of a file of models.

    Parameters
    ----------
    models : iterable of FittedModel
        Of an error ladder: from the base to the last model.
    data : str
        Where the data come from.
    noise_floor_rms : float, optional
        Of the training record, in the output's unit; None where it is not known.
    """
    written = [model.to_json() for model in models]
    return {"schema": SCHEMA, "data": data, "noise_floor_rms": noise_floor_rms, "models": written}


def read_models(content, catalogues: Mapping[str, Mapping[str, Effect]]) -> list[FittedModel]:
    """Return the models of a file.

    Parameters
    ----------
    content : object
        As read from JSON.
    catalogues : mapping of str to mapping
        Effects by name for every system, as `lumbar.tissue.effects.catalogue.CATALOGUES`.

    Raises
    ------
    InputError
        With the place of everything that is missing, unknown or not allowed in any model.
    """
    problems = Problems("models.json")
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = repr(content.get("schema")) if isinstance(content, dict) else type(content).__name__
        problems.add("schema", found, f"{SCHEMA!r} is needed; make the file anew with identify or refine")
    elif content.get("models") == []:
        needed = (
            "a list of at least one is needed; linear dynamics behind a sensor stand in diagnosis.json alone"
        )
        problems.add("models", "no model", needed)
    elif not isinstance(content.get("models"), list):
        problems.add("models", repr(content.get("models")), "a list of models is needed")
    problems.raise_if_any()
    models = []
    for index, entry in enumerate(content["models"]):
        own = Problems(f"models.{entry.get('name', index) if isinstance(entry, dict) else index}")
        fields = checked_entry(entry, catalogues, own)
        models += [FittedModel(**fields)] if fields else []
        problems.extend(own)
    problems.raise_if_any()
    return models
