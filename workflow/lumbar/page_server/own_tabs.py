"""The tabs of the page for own recordings: which are held, and which is let go."""

from __future__ import annotations

import secrets

from lumbar.page_server.own_recordings import OwnRecordings
from lumbar.page_server.served_sets import OWN

MOST_TABS = 16
"""Tabs that are held; the one that was used longest ago is let go for one more."""


class OwnTabs:
    """The tabs that recordings were given in, each by a name that nobody guesses."""

    def __init__(self) -> None:
        self._tabs: dict[str, OwnRecordings] = {}

    def new(self) -> str:
        """Return the name of a new tab."""
        while len(self._tabs) >= MOST_TABS:
            del self._tabs[next(iter(self._tabs))]
        name = secrets.token_urlsafe(16)
        self._tabs[name] = OwnRecordings(f"{OWN}?tab={name}")
        return name

    def find(self, name: str) -> OwnRecordings | None:
        """Return a tab's recordings; None where it is not held any more."""
        found = self._tabs.pop(name, None)
        if found is not None:
            self._tabs[name] = found  # now the last to be let go
        return found
