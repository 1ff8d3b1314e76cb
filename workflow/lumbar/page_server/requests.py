"""What the served page may ask for, and send over its line: a model fitted, files written, effects kept in the study."""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from bokeh.protocol.exceptions import ProtocolError
from bokeh.protocol.message import Message
from bokeh.server.views.ws import WSHandler

from lumbar.base.errors import InputError
from lumbar.base.files import refuse_links
from lumbar.page_server.background import DRAWING, WRITING, page_message
from lumbar.page_server.served_sets import ExploredSet
from lumbar.page_server.study_change import Change
from lumbar.publishing.explorer.page import excitation_of, model_facts
from lumbar.publishing.explorer.shown import ShownModel
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.diagnosis.evidence.evidence import machine_limits

if TYPE_CHECKING:
    from lumbar.interface.refinement import Refinement

MOST_BYTES = 10_000
"""Largest message that a page may send: what it asks for is a line, what its pictures tell are a few numbers."""
_MESSAGES = ("PULL-DOC-REQ", "PATCH-DOC")
_TYPES = ("map", "number", "event")
"""Values that Bokeh unfolds and that a page sends; others, among them packed bytes and whole models, fill the memory."""


class PageSocket(WSHandler):
    """Bokeh's, which takes the messages of a page and closes at any other."""

    async def _receive(self, fragment: str | bytes) -> Message[Any] | None:
        try:
            if not isinstance(fragment, str):
                raise ProtocolError("bytes from a page")
            message = await super()._receive(fragment)
            if message is not None and not (message.msgtype in _MESSAGES and is_plain(message.content)):
                raise ProtocolError("a message that no page sends")
        except (ProtocolError, RecursionError) as error:
            self._protocol_error(str(error))
            return None
        return message


def is_plain(content: Any) -> bool:
    """Whether a message's content holds numbers, texts, lists and mappings of them alone.

    Examples
    --------
    >>> is_plain({"new": {"type": "map", "entries": [["content", ["{}"]]]}})
    True
    >>> is_plain({"new": [{"type": "bytes", "data": "H4sIAAAAAAAC"}]})
    False
    """
    if isinstance(content, dict):
        return content.get("type", "map") in _TYPES and all(map(is_plain, content.values()))
    return all(map(is_plain, content)) if isinstance(content, list) else True


MOST_EFFECTS = 8
"""Most effects of a model that the page asks for."""


@dataclass(eq=False)
class TabRequests:
    """The requests of one tab, answered one after the other."""

    explored: ExploredSet
    proposed: Change | None = field(default=None)
    """The change of the study that was shown and not yet written."""
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
            "keep": self._keep,
            "write": self._write,
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
        verdict = replace(diagnosis.verdict, tied_with=[self.explored.refitted(effects).path[-1]])
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

    def _keep(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        if self.explored.keep is None:
            raise InputError("no study stands behind these records: 'lumbar explore' was given a folder")
        # In the order in which they were fitted, whichever tab asked for them first: the workflow fits them so again.
        self.proposed = self.explored.keep(self.explored.refitted(effects).effects)
        if not self.proposed.diff:
            return {"text": f"{self.proposed.path} holds this already."}, []
        return {"text": "Look at the change, then write it.", "diff": self.proposed.diff}, []

    def _write(self, effects: list[str]) -> tuple[dict, list[ShownModel]]:
        if self.proposed is None:
            raise InputError("no change was shown that could be written")
        change, self.proposed = self.proposed, None
        with WRITING:
            change.write()
        return {"text": f"{change.path} is written; 'snakemake' now makes the same model."}, []


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
        export_fmu(refit.model, folder, data=refit.data)
    return sorted(path.name for path in folder.iterdir() if path.is_file())
