"""Pages of lifts beside those of diagnoses: made when first asked for; they need no server behind them."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from tornado.routing import PathMatches, Rule
from tornado.web import RequestHandler

from lumbar.interface.lift_page import lift_page
from lumbar.page_server.background import in_background, page_message

if TYPE_CHECKING:
    from lumbar.settings.stability import StabilitySettings


@dataclass(eq=False)
class ServedLift:
    """A saved lift and its page."""

    folder: Path
    """That `lumbar lift` or a study wrote; its name is the lift's."""
    settings: StabilitySettings
    data: str = ""
    """Words for the source of the data; empty for those of the lift."""
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
            self.write(await in_background(self.lift.html))
        except Exception as error:
            self.set_status(500)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.write(page_message(error))


def lift_rules(lifts: Sequence[ServedLift]) -> list[Rule]:
    """Addresses of the pages of these lifts."""
    return [Rule(PathMatches(f"{re.escape(lift.address)}$"), LiftHandler, {"lift": lift}) for lift in lifts]
