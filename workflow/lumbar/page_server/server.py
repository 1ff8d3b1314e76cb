"""The server of the pages, for the user of this machine only."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING

from bokeh.document import Document
from bokeh.models import CustomJS
from tornado.routing import AnyMatches, Rule

from lumbar.base.errors import InputError
from lumbar.base.templates import template
from lumbar.page_server.background import in_background
from lumbar.page_server.index import Index, IndexedHandler, NotReady, WaitingHandler
from lumbar.page_server.own_recordings import MAX_FILE, OwnDiagnosis, own_rules
from lumbar.page_server.requests import TabRequests
from lumbar.page_server.served_sets import RESULT
from lumbar.page_server.trust import HOST, DoorHandler, Outside, SecurityHeaders, Visitors, log_rejected
from lumbar.publishing.explorer.explorer_page import PAGE
from lumbar.publishing.explorer.explorer_pictures import ANSWER, REQUEST

if TYPE_CHECKING:
    from bokeh.server.server import Server

MOST_MESSAGE = 10_000
"""Bytes of a page's message: a request is one line, events of pictures are a few numbers."""
_LOST = """
document.body.removeAttribute("aria-busy");
const message = document.getElementById("message");
message.textContent = "The server was ended: what is here can still be looked at. Start 'lumbar explore' again, then load "
  + "the page again.";
message.className = "bad";
"""
"""Script of a page that has lost its server."""


def new_server(index: Index, port: int, own: OwnDiagnosis) -> tuple[Server, Visitors]:
    """Return a server of an index and its pages on the loopback interface, and its visitors.

    Parameters
    ----------
    port : int
        0 takes a free one.
    own : OwnDiagnosis
        Diagnosis of recordings that are given on the page.

    Raises
    ------
    InputError
        If the port is taken.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    applications = {
        path: Application(FunctionHandler(partial(_fill, path=path, index=index)))
        for path in (*index.sets.given, RESULT)
    }
    try:
        server = Server(
            applications,
            port=port,
            address=HOST,
            allow_websocket_origin=[f"{HOST}:{port}", f"localhost:{port}"] if port else None,
            websocket_max_message_size=MOST_MESSAGE,
            include_headers=[],  # so that a page's session data contain no cookies
            include_cookies=[],
            log_function=log_rejected,
            http_server_kwargs={"max_buffer_size": MAX_FILE},
        )
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror or error}; choose another with --port") from error
    visitors = Visitors(server.port)
    _route(server, visitors, index, own)
    return server, visitors


def _route(server: Server, visitors: Visitors, index: Index, own: OwnDiagnosis) -> None:
    """Add access control and the server's pages before Bokeh's, and remove handlers without use."""
    from bokeh.server.views.autoload_js_handler import AutoloadJsHandler
    from bokeh.server.views.metadata_handler import MetadataHandler
    from bokeh.server.views.root_handler import RootHandler

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
    application.add_transform(SecurityHeaders)


def _fill(document: Document, path: str, index: Index) -> None:
    """Fill a tab's document if its set is ready; `WaitingHandler` answers for others."""
    explored = index.sets.find(path, document.session_context.request.arguments)
    if explored is None or not explored.ready:
        return
    page = explored.page
    page.fill(document)
    document.title = page.title
    document.template = template(PAGE)
    document.template_variables.update(explored.variables | index.bar)
    document.config.notify_connection_status = False  # Bokeh's message promises that the connection returns
    document.js_on_event("connection_lost", CustomJS(code=_LOST))
    requests = TabRequests(explored)

    def asked(_attribute, _old, new) -> None:
        content = new.get("content") or [""]
        document.add_next_tick_callback(partial(_answered, document, requests, str(content[0])))

    document.get_model_by_name(REQUEST).on_change("data", asked)


async def _answered(document: Document, requests: TabRequests, text: str) -> None:
    """Answer without blocking other tabs."""
    content, models = await in_background(requests.answer, text)
    for model in models:
        for record in model.values:
            for kind, columns in (("record", model.values), ("spectrum", model.density)):
                source = document.get_model_by_name(f"{kind}:{record}")
                if model.key not in source.data:
                    source.add(columns[record], model.key)
    document.get_model_by_name(ANSWER).data = {"content": [json.dumps(content)]}
