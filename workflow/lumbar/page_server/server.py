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
from lumbar.page_server.background import run_in_background
from lumbar.page_server.index import Index, IndexedHandler, NotReady, ProgressHandler
from lumbar.page_server.own_recordings import MAX_FILE_BYTES, UploadDiagnosis, upload_rules
from lumbar.page_server.served_sets import RESULT, TabRequests
from lumbar.page_server.trust import HOST, DoorHandler, Outside, SecurityHeaders, Visitors, log_rejected
from lumbar.publishing.explorer.explorer_page import PAGE
from lumbar.publishing.explorer.explorer_pictures import ANSWER, REQUEST

if TYPE_CHECKING:
    from bokeh.server.server import Server

_MAX_MESSAGE_BYTES = 10_000
"""Largest message of a page: a request is one line, events of pictures are a few numbers."""
_LOST = """
document.body.removeAttribute("aria-busy");
const message = document.getElementById("message");
message.textContent = "The server was ended: what is here can still be looked at. Start 'lumbar explore' again, then load "
  + "the page again.";
message.className = "bad";
"""
"""Script of a page that has lost its server."""


def new_server(index: Index, port: int, uploads: UploadDiagnosis) -> tuple[Server, Visitors]:
    """Return a server of an index and its pages on the loopback interface, and its visitors.

    Port 0 takes a free one; `uploads` diagnoses the user's recordings.

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
        for path in (*index.sets.named, RESULT)
    }
    try:
        server = Server(
            applications,
            port=port,
            address=HOST,
            allow_websocket_origin=[f"{HOST}:{port}", f"localhost:{port}"] if port else None,
            websocket_max_message_size=_MAX_MESSAGE_BYTES,
            include_headers=[],  # so that a page's session data contain no cookies
            include_cookies=[],
            log_function=log_rejected,
            http_server_kwargs={"max_buffer_size": MAX_FILE_BYTES},
        )
    except OSError as error:
        raise InputError(f"port {port}: {error.strerror or error}; choose another with --port") from error
    visitors = Visitors(server.port)
    _route(server, visitors, index, uploads)
    return server, visitors


def _route(server: Server, visitors: Visitors, index: Index, uploads: UploadDiagnosis) -> None:
    """Add access control and the server's pages before Bokeh's, and remove handlers without use."""
    from bokeh.server.views.autoload_js_handler import AutoloadJsHandler
    from bokeh.server.views.metadata_handler import MetadataHandler
    from bokeh.server.views.root_handler import RootHandler

    application = server._tornado
    inner = application.wildcard_router.rules
    inner[:] = [
        rule for rule in inner if rule.target not in (AutoloadJsHandler, MetadataHandler, RootHandler)
    ]
    arguments = {"index": index}
    application.default_router.rules[:0] = [
        Rule(Outside(visitors), DoorHandler, {"visitors": visitors}),
        Rule(NotReady(index.sets), ProgressHandler, arguments),
        *upload_rules(index, uploads),
        *index.rules(),
    ]
    inner.append(Rule(AnyMatches(), IndexedHandler, arguments))
    application.add_transform(SecurityHeaders)


def _fill(document: Document, path: str, index: Index) -> None:
    """Fill a tab's document if its set is ready; `ProgressHandler` answers for others."""
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

    def answer(_attribute, _old, new) -> None:
        text = str((new.get("content") or [""])[0])
        document.add_next_tick_callback(partial(_answer, document, requests, text))

    document.get_model_by_name(REQUEST).on_change("data", answer)


async def _answer(document: Document, requests: TabRequests, text: str) -> None:
    """Answer without blocking other tabs."""
    content, models = await run_in_background(requests.answer, text)
    for model in models:
        for record in model.values:
            for kind, columns in (("record", model.values), ("spectrum", model.density)):
                source = document.get_model_by_name(f"{kind}:{record}")
                if model.key not in source.data:
                    source.add(columns[record], model.key)
    document.get_model_by_name(ANSWER).data = {"content": [json.dumps(content)]}
