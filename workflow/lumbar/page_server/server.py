"""The server of the page: on this machine alone, for whoever sits in front of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from bokeh.document import Document
from bokeh.models import CustomJS
from tornado.routing import AnyMatches, Rule

from lumbar.base.errors import InputError
from lumbar.base.templates import template
from lumbar.page_server.background import in_background
from lumbar.page_server.index import Index, IndexedHandler
from lumbar.page_server.own_recordings import MOST_FILE, OwnDiagnosis
from lumbar.page_server.requests import TabRequests
from lumbar.page_server.served_sets import RESULT, ExploredSet, ServedSets
from lumbar.page_server.trust import HOST, DoorHandler, Guarded, Outside, Visitors, log_refused
from lumbar.page_server.waiting import NotReady, WaitingHandler
from lumbar.publishing.explorer.explorer_page import PAGE
from lumbar.publishing.explorer.explorer_pictures import ANSWER, REQUEST

if TYPE_CHECKING:
    from bokeh.server.server import Server

MOST_MESSAGE = 10_000
"""Bytes of a message of a page: what it asks for is a line, what its pictures tell are a few numbers."""
_LOST = """
document.body.removeAttribute("aria-busy");
const message = document.getElementById("message");
message.textContent = "The server was ended: what is here can still be looked at. Start 'lumbar explore' again, then load "
  + "the page again.";
message.className = "bad";
"""
"""What the page says when nobody answers it any more."""


def new_server(index: Index, port: int, own: OwnDiagnosis) -> tuple[Server, Visitors]:
    """Return a server of an index and its pages that listens on the loopback interface, and who may come in.

    Parameters
    ----------
    port : int
        0 takes a free one.
    own : OwnDiagnosis
        How recordings that are given on the page are diagnosed.

    Raises
    ------
    InputError
        If the port is taken.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    pages: dict[str, Callable[[Document], ExploredSet | None]] = {
        address: partial(_given, explored=explored) for address, explored in index.sets.given.items()
    }
    pages[RESULT] = partial(_asked_for, served=index.sets)
    applications = {
        address: Application(FunctionHandler(partial(_fill, find=find, index=index)))
        for address, find in pages.items()
    }
    try:
        server = Server(
            applications,
            port=port,
            address=HOST,
            allow_websocket_origin=[f"{HOST}:{port}", f"localhost:{port}"] if port else None,
            websocket_max_message_size=MOST_MESSAGE,
            include_headers=[],  # what a page is told of its session holds none of its cookies
            include_cookies=[],
            log_function=log_refused,
            http_server_kwargs={"max_buffer_size": MOST_FILE},
        )
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror or error}; choose another with --port") from error
    visitors = Visitors(server.port)
    _route(server, visitors, index, own)
    return server, visitors


def _route(server: Server, visitors: Visitors, index: Index, own: OwnDiagnosis) -> None:
    """Put a door and the server's own pages before Bokeh's, and take away what nobody needs."""
    from bokeh.server.views.autoload_js_handler import AutoloadJsHandler
    from bokeh.server.views.metadata_handler import MetadataHandler
    from bokeh.server.views.root_handler import RootHandler

    from lumbar.page_server.own_handlers import own_rules

    application = server._tornado
    inner = application.wildcard_router.rules
    inner[:] = [
        rule for rule in inner if rule.target not in (AutoloadJsHandler, MetadataHandler, RootHandler)
    ]
    known = {"index": index}
    application.default_router.rules[:0] = [
        Rule(Outside(visitors), DoorHandler, {"visitors": visitors}),
        Rule(NotReady(index.sets), WaitingHandler, known),
        *own_rules(index, own),
        *index.rules(),
    ]
    inner.append(Rule(AnyMatches(), IndexedHandler, known))
    application.add_transform(Guarded)


def _given(_document: Document, explored: ExploredSet) -> ExploredSet:
    return explored


def _asked_for(document: Document, served: ServedSets) -> ExploredSet | None:
    """The set of own recordings that the address names."""
    return served.find(RESULT, document.session_context.request.arguments)


def _fill(document: Document, find: Callable[[Document], ExploredSet | None], index: Index) -> None:
    """Fill a tab's document; of a set that is not ready the page in waiting is shown instead."""

    explored = find(document)
    if explored is None or not explored.ready:
        return
    page = explored.page
    page.fill(document)
    document.title = page.title
    document.template = template(PAGE)
    document.template_variables.update(explored.variables | index.bar)
    document.config.notify_connection_status = False  # Bokeh would speak of a line that comes back
    document.js_on_event("connection_lost", CustomJS(code=_LOST))
    requests = TabRequests(explored)

    def asked(_attribute, _old, new) -> None:
        content = new.get("content") or [""]
        document.add_next_tick_callback(partial(_answered, document, requests, str(content[0])))

    document.get_model_by_name(REQUEST).on_change("data", asked)


async def _answered(document: Document, requests: TabRequests, text: str) -> None:
    """Answer while other tabs go on."""
    content, models = await in_background(requests.answer, text)
    for model in models:
        for record in model.values:
            for kind, columns in (("record", model.values), ("spectrum", model.density)):
                source = document.get_model_by_name(f"{kind}:{record}")
                if model.key not in source.data:
                    source.add(columns[record], model.key)
    document.get_model_by_name(ANSWER).data = {"content": [json.dumps(content)]}
