"""Pages of lifts beside those of diagnoses: made when first asked for; they need no server behind them."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from tornado.routing import HostMatches, Matcher, PathMatches, Rule
from tornado.web import RequestHandler

from lumbar.errors import LumbarError
from lumbar.interface.lift_page import lift_page

if TYPE_CHECKING:
    from bokeh.server.server import Server

    from lumbar.settings.stability import StabilitySettings

THIS_MACHINE = r"(127\.0\.0\.1|localhost)"


@dataclass(eq=False)
class ServedLift:
    """A saved lift and its page.

    Attributes
    ----------
    folder : pathlib.Path
        That `lumbar lift` or a study wrote; its name is the lift's.
    settings : StabilitySettings
    data : str
        Words for the source of the data; empty for those of the lift.
    """

    folder: Path
    settings: StabilitySettings
    data: str = ""
    _one_at_a_time: threading.Lock = field(default_factory=threading.Lock)

    @property
    def address(self) -> str:
        """Path of the page on the server."""
        return f"/lifts/{quote(self.folder.absolute().name)}"

    @cached_property
    def _html(self) -> str:
        return lift_page(self.folder, settings=self.settings, data=self.data).to_html()

    def html(self) -> str:
        """Return the page, made once."""
        with self._one_at_a_time:
            return self._html


class LiftHandler(RequestHandler):
    """Answers with the page of a lift, or with why there is none."""

    def initialize(self, lift: ServedLift) -> None:
        """Take the lift."""
        self.lift = lift

    async def get(self) -> None:
        """Answer while other pages go on."""
        try:
            self.write(await asyncio.to_thread(self.lift.html))
        except LumbarError as error:
            self.set_status(500)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.write(str(error))


class _Here(Matcher):
    """One path on this machine's names alone."""

    def __init__(self, path: str):
        self.matchers = HostMatches(THIS_MACHINE), PathMatches(path)

    def match(self, request):
        """Match where both do."""
        found = [matcher.match(request) for matcher in self.matchers]
        return None if None in found else found[-1]


def add_lifts(server: Server, lifts: Sequence[ServedLift]) -> None:
    """Serve the pages of these lifts too."""
    server._tornado.default_router.rules[:0] = [
        Rule(_Here(f"{re.escape(lift.address)}$"), LiftHandler, {"lift": lift}) for lift in lifts
    ]
