"""What the served page may ask for, and the answers: a model fitted, files written, effects kept in the study."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lumbar.errors import InputError, LumbarError
from lumbar.page_server.explored_set import ExploredSet
from lumbar.page_server.kept_effects import Change, keep_effects
from lumbar.reports.explorer.page import told
from lumbar.reports.explorer.shown import ShownModel, shown_model

if TYPE_CHECKING:
    from lumbar.interface.diagnosis import Refinement

MOST_EFFECTS = 8
"""Most effects of a model that the page asks for."""


@dataclass(eq=False)
class TabRequests:
    """The requests of one tab.

    Attributes
    ----------
    explored : ExploredSet
    proposed : Change or None
        The change of the study that was shown and not yet written.
    """

    explored: ExploredSet
    proposed: Change | None = field(default=None)

    def answer(self, text: str) -> tuple[dict[str, Any], ShownModel | None]:
        """Do what is asked.

        Parameters
        ----------
        text : str
            JSON with ``number``, ``action`` and ``effects``.

        Returns
        -------
        dict
            What the page is told; ``error`` where it could not be done.
        ShownModel or None
            A new model for the pictures.
        """
        asked = json.loads(text)
        number = asked.get("number")
        actions = {"fit": self._fit, "save": self._save, "keep": self._keep, "write": self._write}
        try:
            if asked.get("action") not in actions:
                raise InputError(f"{asked.get('action')!r}: unknown request; there are: {', '.join(actions)}")
            content, model = actions[asked["action"]](self._effects(asked))
        except (LumbarError, OSError) as error:
            return {"number": number, "error": str(error)}, None
        return {"number": number, **content}, model

    def _effects(self, asked: dict) -> list[str]:
        effects = asked.get("effects", [])
        known = self.explored.diagnosis.candidates
        if not isinstance(effects, list) or len(effects) > MOST_EFFECTS:
            raise InputError(f"{effects!r}: a list of up to {MOST_EFFECTS} effects is needed")
        wrong = [name for name in effects if name not in known]
        if wrong:
            raise InputError(f"unknown effect {wrong[0]!r}")
        return effects

    def _fit(self, effects: list[str]) -> tuple[dict, ShownModel]:
        refit, diagnosis = self.explored.refitted(effects), self.explored.diagnosis
        model = shown_model(refit.path[-1], [], diagnosis.verdict, self.explored.page.step)
        located = refit.locate().simulated
        return {"model": told(model, located), "key": model.key, "effects": effects}, model

    def _save(self, effects: list[str]) -> tuple[dict, None]:
        refit, folder = self.explored.refitted(effects), self.explored.output
        written = save_refinement(refit, folder)
        return {"text": f"{len(written)} files written to {folder}."}, None

    def _keep(self, effects: list[str]) -> tuple[dict, None]:
        if self.explored.study_file is None:
            raise InputError("no study stands behind these records: 'lumbar explore' was given a folder")
        self.proposed = keep_effects(self.explored.study_file, effects)
        if not self.proposed.diff:
            return {"text": f"{self.proposed.path} holds these effects already."}, None
        return {"text": "Look at the change, then write it.", "diff": self.proposed.diff}, None

    def _write(self, effects: list[str]) -> tuple[dict, None]:
        if self.proposed is None:
            raise InputError("no change was shown that could be written")
        change, self.proposed = self.proposed, None
        change.write()
        return {
            "text": f"{change.path} is written; 'snakemake' now makes the model with these effects."
        }, None


def save_refinement(refit: Refinement, folder) -> list[str]:
    """Write the model, its tables and figures, and its FMUs; return the files' names."""
    from lumbar.interface.device import export_fmu

    refit.save(folder)
    refit.compare().save(folder)
    refit.locate().save(folder)
    export_fmu(refit.model, folder, data=refit.data)
    return sorted(path.name for path in folder.iterdir() if path.is_file())
