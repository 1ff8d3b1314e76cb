"""The tabs of the page for own recordings: which are held, which is let go, and how many bytes all of them may take."""

from __future__ import annotations

import secrets

from lumbar.base.errors import InputError
from lumbar.page_server.own_recordings import OwnRecordings
from lumbar.page_server.served_sets import OWN

MOST_TABS = 16
"""Tabs that are held with files, and as many without."""
MOST_HELD = 300_000_000
"""Bytes of all files that are held or on their way."""


class OwnTabs:
    """The tabs that recordings were given in, each by a name that nobody guesses; the one that was used last comes last.

    To open the page holds nothing and lets no files go: any page of the web can lead a browser there. Files that a person gives
    do, where there is no room else.
    """

    def __init__(self) -> None:
        self._tabs: dict[str, OwnRecordings] = {}
        self._coming = 0

    def new(self) -> str:
        """Return the name of a new tab; of those without files the one that was used longest ago is let go for it."""
        empty = [name for name, tab in self._tabs.items() if not tab.files]
        for name in empty[: max(0, len(empty) - MOST_TABS + 1)]:
            del self._tabs[name]
        name = secrets.token_urlsafe(16)
        self._tabs[name] = OwnRecordings(f"{OWN}?tab={name}")
        return name

    def find(self, name: str) -> OwnRecordings | None:
        """Return a tab's recordings; None where it is not held any more."""
        found = self._tabs.pop(name, None)
        if found is not None:
            self._tabs[name] = found
        return found

    def expect(self, tab: OwnRecordings, name: str, size: int) -> None:
        """Count a file that is on its way to a tab; other tabs that were used longest ago are let go for it.

        Raises
        ------
        InputError
            If there is no room for it, whichever tab is let go.
        """
        taken = tab.size_besides(name) + self._coming
        if taken + size > MOST_HELD:
            raise InputError(
                f"{name:.200}: {size / 1e6:.3g} MB, where this tab holds and expects {taken / 1e6:.3g} MB and "
                f"{MOST_HELD / 1e6:.0f} MB are the most; take a file away, or use lumbar import"
            )
        self._coming += size
        others = {
            key: other.size_besides() for key, other in self._tabs.items() if other.files and other is not tab
        }
        for key in list(others):
            if len(others) < MOST_TABS and taken + size + sum(others.values()) <= MOST_HELD:
                break
            del self._tabs[key], others[key]

    def arrived(self, size: int) -> None:
        """Count a file as held by its tab, or not at all where it did not come whole."""
        self._coming -= size
