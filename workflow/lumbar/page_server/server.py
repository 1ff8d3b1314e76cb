"""The server of the page: on this machine alone, for whoever sits in front of it."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from lumbar.errors import InputError
from lumbar.page_server.explored_set import ExploredSet
from lumbar.page_server.requests import TabRequests
from lumbar.reports.explorer.page import PAGE
from lumbar.reports.explorer.plots import ANSWER, REQUEST
from lumbar.templates import template

if TYPE_CHECKING:
    from bokeh.document import Document
    from bokeh.server.server import Server

HOST = "127.0.0.1"
MOST_BYTES = 1_000_000
"""Largest message that a page may send: what it asks for is a line."""


def new_server(sets: Sequence[ExploredSet], port: int) -> Server:
    """Return a server of these sets, each at its name, that listens on the loopback interface.

    Parameters
    ----------
    sets : sequence of ExploredSet
    port : int
        0 takes a free one.

    Raises
    ------
    InputError
        If the port is taken.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    applications = {
        f"/{explored.name}": Application(FunctionHandler(partial(_fill, explored=explored)))
        for explored in sets
    }
    try:
        server = Server(
            applications,
            port=port,
            address=HOST,
            allow_websocket_origin=[f"{HOST}:{port}", f"localhost:{port}"] if port else None,
            websocket_max_message_size=MOST_BYTES,
        )
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror or error}; choose another with --port") from error
    _refuse_other_hosts(server)
    return server


def _refuse_other_hosts(server: Server) -> None:
    """Answer to this machine's names only: a page of elsewhere whose name was made to lead here gets nothing."""
    from tornado.routing import HostMatches

    names = rf"({re.escape(HOST)}|localhost)"
    for rule in server._tornado.default_router.rules:
        rule.matcher = HostMatches(names)


def _fill(document: Document, explored: ExploredSet) -> None:
    """Fill a tab's document."""
    page = explored.page
    page.fill(document)
    study = "" if explored.study_file is None else explored.study_file.name
    document.title = page.title
    document.template = template(PAGE)
    document.template_variables.update(page.variables(served=True, study=study))
    requests = TabRequests(explored)

    def asked(_attribute, _old, new) -> None:
        document.add_next_tick_callback(partial(_answered, document, requests, new["content"][0]))

    document.get_model_by_name(REQUEST).on_change("data", asked)


async def _answered(document: Document, requests: TabRequests, text: str) -> None:
    """Answer while other tabs go on."""
    content, models = await asyncio.to_thread(requests.answer, text)
    for model in models:
        for record in model.values:
            for kind, columns in (("record", model.values), ("spectrum", model.density)):
                source = document.get_model_by_name(f"{kind}:{record}")
                if model.key not in source.data:
                    source.add(columns[record], model.key)
    document.get_model_by_name(ANSWER).data = {"content": [json.dumps(content)]}
