"""The sets that a server shows: those of the study or folder, and those of recordings given on the page."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence

from lumbar.page_server.explored_set import ExploredSet

OWN = "/_own"
"""Address of the page for own recordings; no record set's name begins so."""
RESULT = f"{OWN}/result"
MOST_OWN = 8
"""Sets of own recordings that are held; the oldest is let go for one more."""


class ServedSets:
    """Sets by the address of their page.

    Parameters
    ----------
    given : sequence of ExploredSet
    """

    def __init__(self, given: Sequence[ExploredSet]):
        self.given = {f"/{explored.name}": explored for explored in given}
        self._own: dict[str, ExploredSet] = {}

    def is_own(self, path: str) -> bool:
        """Whether this is the address of own recordings' results."""
        return path.rstrip("/") == RESULT

    def find(self, path: str, arguments: Mapping[str, list[bytes]]) -> ExploredSet | None:
        """Return the set that an address shows; None for any other."""
        if not self.is_own(path):
            return self.given.get(path.rstrip("/"))
        asked = arguments.get("set") or [b""]
        return self._own.get(asked[-1].decode(errors="replace"))

    def add_own(self, explored: ExploredSet) -> str:
        """Hold a set of own recordings; return the address of its page."""
        while len(self._own) >= MOST_OWN:
            oldest = next(iter(self._own))
            job = self._own.pop(oldest).job
            if job is not None:
                job.cancel()
        name = secrets.token_urlsafe(16)
        self._own[name] = explored
        return f"{RESULT}?set={name}"
