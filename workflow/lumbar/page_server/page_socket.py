"""The line between a page and its document on the server: what the page may send over it."""

from __future__ import annotations

from typing import Any

from bokeh.protocol.exceptions import ProtocolError
from bokeh.protocol.message import Message
from bokeh.server.views.ws import WSHandler

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
