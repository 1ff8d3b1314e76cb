"""What the served page may ask for over its line: a model fitted, where it fails, an excitation, files written."""

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
from lumbar.publishing.explorer.shown import ShownModel
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.diagnosis.evidence.evidence import machine_limits

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement

MOST_EFFECTS = 8
"""Most effects of a model that the page asks for."""


@dataclass(eq=False)
class TabRequests:
    """The requests of one tab, answered one after the other."""

    explored: ExploredSet
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    def answer(self, text: str) -> tuple[dict[str, Any], list[ShownModel]]:
        """Do what is asked.

        Parameters
        ----------
        text : str
            JSON with ``number``, ``action`` and ``effects``.

        Returns
        -------
        dict
            What the page is told; ``error`` where it could not be done.
        list of ShownModel
            New models for the pictures.
        """
        number = None
        actions = {
            "fit": self._fit,
            "locate": self._locate,
            "separate": self._separate,
            "save": self._save,
        }
        try:
            asked = read_request(text)
            number = asked.get("number")
            if not isinstance(number, int):
                raise InputError("a request without a number")
            action = asked.get("action")
            if not isinstance(action, str) or action not in actions:
                raise InputError(f"{action!r}: unknown request; there are: {', '.join(actions)}")
            with self._one_at_a_time:
                content, models = actions[action](self._effects(asked))
        except Exception as error:
            return {"number": number, "error": page_message(error)}, []
        return {"number": number, **content}, models

    def _effects(self, asked: dict) -> list[str]:
        effects = asked.get("effects", [])
        known = self.explored.diagnosis.candidates
        wanted = f"{effects!r:.80}: a list of up to {MOST_EFFECTS} effects is needed, none of them twice"
        if not isinstance(effects, list) or len(effects) > MOST_EFFECTS:
            raise InputError(wanted)
        wrong = [name for name in effects if not isinstance(name, str) or name not in known]
        if wrong:
            raise InputError(f"unknown effect {wrong[0]!r:.80}")
        if len(set(effects)) < len(effects):
            raise InputError(wanted)
        return effects

    def _fit(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        """Every step of the path, and where its end fails."""
        models = [self.explored.fitted(effects[:count]) for count in range(len(effects) + 1)]
        located = {models[-1].key: self.explored.refitted(effects).locate().simulated}
        content = {model.key: model_facts(model, located.get(model.key, [])) for model in models}
        return {"models": content, "effects": effects}, models

    def _locate(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        model = self.explored.fitted(effects)
        located = self.explored.refitted(effects).locate().simulated
        return {"key": model.key, "located": model_facts(model, located)["located"]}, []

    def _separate(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        """The excitation that tells these effects from the selected ones."""
        diagnosis = self.explored.diagnosis
        verdict = replace(diagnosis.result, tied_with=[self.explored.refitted(effects).path[-1]])
        limits = machine_limits(diagnosis.study.signals.machine, verdict.experiment)
        found = None if diagnosis.settings.forward else separating_excitation(verdict, limits)
        if found is None:
            raise InputError(
                "no excitation can be named: the force is the records' input, or an effect hangs on a further channel"
            )
        return {"excitation": excitation_of(found, verdict)}, []

    def _save(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        refit, folder = self.explored.refitted(effects), self.explored.output
        written = save_refinement(refit, folder)
        return {"text": f"{len(written)} files written to {folder}."}, []


def read_request(text: str | bytes) -> dict[str, Any]:
    """Return what a page sent as JSON.

    Raises
    ------
    InputError
        If it is no mapping in JSON.
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
