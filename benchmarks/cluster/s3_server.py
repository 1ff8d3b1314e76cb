"""moto's S3 server on a free port; it can hold an upload at half its body, so that its client can be killed there.

Runs in an environment that has moto: ``python s3_server.py FOLDER``. The port is written to ``FOLDER/port``. An upload whose
address contains the words in ``FOLDER/hold`` is read to the half and never stored; ``FOLDER/held`` then names it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

LONGEST_HOLD_S = 60


class Holding:
    """WSGI application before moto's."""

    def __init__(self, application, folder: Path):
        self.application = application
        self.folder = folder

    def __call__(self, environ, start_response):
        order = self.folder / "hold"
        if (
            environ["REQUEST_METHOD"] == "PUT"
            and order.is_file()
            and order.read_text() in environ["PATH_INFO"]
        ):
            return self.held(environ, start_response, order)
        return self.application(environ, start_response)

    def held(self, environ, start_response, order: Path):
        environ["wsgi.input"].read(int(environ["CONTENT_LENGTH"]) // 2)
        (self.folder / "held").write_text(environ["PATH_INFO"])
        deadline = time.monotonic() + LONGEST_HOLD_S
        while order.is_file() and time.monotonic() < deadline:
            time.sleep(0.02)
        start_response("503 Slow Down", [("Content-Length", "0")])
        return []


def main(folder: Path) -> None:
    """Serve until ended."""
    moto = DomainDispatcherApplication(create_backend_app)
    server = make_server("127.0.0.1", 0, Holding(moto, folder), threaded=True)
    (folder / "port").write_text(str(server.server_port))
    server.serve_forever()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
