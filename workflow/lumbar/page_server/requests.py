"""Requests of the served page: fit a model, locate its errors, compute a separating excitation, write files."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import refuse_links
from lumbar.page_server.background import DRAWING, WRITING, page_message
from lumbar.page_server.served_sets import ExploredSet
from lumbar.publishing.explorer.explorer_page import excitation_of, model_facts
from lumbar.publishing.explorer.page_data import ModelData
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.diagnosis.evidence.evidence import machine_limits

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement

MAX_EFFECTS = 8
"""Most effects of a requested model."""
ACTIONS = ("fit", "locate", "separate", "save")


@dataclass(eq=False)
class TabRequests:
    """The requests of one tab, answered one after the other."""

    explored: ExploredSet
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def answer(self, text: str) -> tuple[dict[str, Any], list[ModelData]]:
        """Answer a request.

        Parameters
        ----------
        text : str
            JSON with ``number``, ``action`` and ``effects``.

        Returns
        -------
        dict
            Answer for the page; ``error`` if the request failed.
        list of ModelData
            New models for the pictures.
        """
        number = None
        try:
            asked = read_request(text)
            number = asked.get("number")
            if not isinstance(number, int):
                raise InputError("a request without a number")
            action = asked.get("action")
            if action not in ACTIONS:
                raise InputError(f"{action!r}: unknown request; there are: {', '.join(ACTIONS)}")
            with self._one_at_a_time:
                content, models = self._do(action, self._effects(asked))
        except Exception as error:
            return {"number": number, "error": page_message(error)}, []
        return {"number": number, **content}, models

    def _effects(self, asked: dict) -> list[str]:
        effects = asked.get("effects", [])
        known = self.explored.diagnosis.candidates
        wanted = f"{effects!r:.80}: a list of up to {MAX_EFFECTS} effects is needed, none of them twice"
        if not isinstance(effects, list) or len(effects) > MAX_EFFECTS:
            raise InputError(wanted)
        wrong = [name for name in effects if not isinstance(name, str) or name not in known]
        if wrong:
            raise InputError(f"unknown effect {wrong[0]!r:.80}")
        if len(set(effects)) < len(effects):
            raise InputError(wanted)
        return effects

    def _do(self, action: str, effects: list[str]) -> tuple[dict, list[ModelData]]:
        explored = self.explored
        if action == "fit":
            # Every step of the path, and where its end fails.
            models = [explored.fitted(effects[:count]) for count in range(len(effects) + 1)]
            located = {models[-1].key: explored.refitted(effects).locate().simulated}
            facts = {model.key: model_facts(model, located.get(model.key, [])) for model in models}
            return {"models": facts, "effects": effects}, models
        if action == "locate":
            model = explored.fitted(effects)
            located = model_facts(model, explored.refitted(effects).locate().simulated)["located"]
            return {"key": model.key, "located": located}, []
        if action == "save":
            written = save_refinement(explored.refitted(effects), explored.output)
            return {"text": f"{len(written)} files written to {explored.output}."}, []
        diagnosis = explored.diagnosis
        verdict = replace(diagnosis.result, tied_with=[explored.refitted(effects).path[-1]])
        limits = machine_limits(diagnosis.study.signals.machine, verdict.experiment)
        found = None if diagnosis.settings.forward else separating_excitation(verdict, limits)
        if found is None:
            raise InputError(
                "no excitation can be named: the force is the records' input, or an effect depends on a further channel"
            )
        return {"excitation": excitation_of(found, verdict)}, []


def read_request(text: str | bytes) -> dict[str, Any]:
    """Return a page's JSON request.

    Raises
    ------
    InputError
        If it is not a mapping in JSON.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError("a request that is not JSON") from error
    if not isinstance(content, dict):
        raise InputError("a request that is no mapping")
    return content


def save_refinement(refit: Refinement, folder) -> list[str]:
    """Write the model, its tables and figures, and its FMUs; return the files' names."""
    from lumbar.interface.device import export_fmu

    refuse_links(folder)
    with WRITING, DRAWING:
        refit.save(folder)
        refit.compare().save(folder)
        refit.locate().save(folder)
        export_fmu(refit.model, folder, source_label=refit.source_label)
    return sorted(path.name for path in folder.iterdir() if path.is_file())
