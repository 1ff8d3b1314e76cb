"""A process without threads whose forks parse files for one that has some.

It is started once, by the first that asks or by `start`, imports what readers need, and ends with the process that started it.
Requests are pickled on their way to it, by the process that it belongs to alone; answers come as from any child.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from lumbar.base.child import answer_and_end, received

_PACKAGES = ("pandas", "scipy.io", "h5py", "openpyxl")
_ENDED = b"e"
_one_at_a_time = threading.Lock()
_templates: dict[int, tuple[socket.socket, subprocess.Popen]] = {}
"""The line to the template and itself, by the process that started it: a fork of that has none."""


def start() -> None:
    """Start the template of this process, unless it has one."""
    with _one_at_a_time:
        _line()


def _line() -> socket.socket:
    if os.getpid() not in _templates:
        ours, theirs = socket.socketpair()
        code = f"from lumbar.base.child_template import serve; serve({theirs.fileno()})"
        template = subprocess.Popen(
            [sys.executable, "-c", code],
            **dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL),
            pass_fds=[theirs.fileno()],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        theirs.close()
        _templates[os.getpid()] = ours, template
    return _templates[os.getpid()][0]


def asked_of_template(parse: Callable[[], Any], opened: list[Path]) -> tuple[bytearray | None, bool, int]:
    """What a fork of the template answers, whether it was waited for too long, and its status."""
    request = pickle.dumps((Path.cwd(), parse, opened))
    with _one_at_a_time:
        line = _line()
        ours, theirs = os.pipe()
        try:
            socket.send_fds(line, [struct.pack("=Q", len(request))], [theirs])
            line.sendall(request)
            os.close(theirs)
            answer, late = received(ours)
            line.sendall(_ENDED)
            return answer, late, struct.unpack("=i", _exactly(line, 4))[0]
        except BaseException as error:  # a line on which an answer is left is of no use
            line.close()
            del _templates[os.getpid()]
            if isinstance(error, OSError):
                return None, False, 0
            raise
        finally:
            os.close(ours)


def _exactly(line: socket.socket, size: int) -> bytes:
    found = bytearray()
    while len(found) < size:
        piece = line.recv(min(size - len(found), 1 << 20))
        if not piece:
            raise ConnectionError("the other end is gone")
        found += piece
    return bytes(found)


def serve(number: int) -> None:
    """Fork for every request; end, with the fork that is at work, when nobody is left to ask."""
    for number_of_signal in (signal.SIGINT, signal.SIGTERM):  # which a terminal sends to all
        signal.signal(number_of_signal, signal.SIG_IGN)
    for package in _PACKAGES:
        with contextlib.suppress(ImportError):
            import_module(package)
    line = socket.socket(fileno=number)
    with contextlib.suppress(ConnectionError):
        while True:
            head, pipes, *_ = socket.recv_fds(line, 8, 1)
            if not head:
                return
            folder, parse, opened = pickle.loads(_exactly(line, struct.unpack("=Q", head)[0]))
            child = os.fork()
            if not child:
                with contextlib.suppress(OSError):  # what is named from elsewhere is read all the same
                    os.chdir(folder)
                answer_and_end(parse, pipes[0], opened)
            os.close(pipes[0])
            del parse
            try:
                _exactly(line, 1)
            finally:
                os.kill(child, signal.SIGKILL)  # without effect on one that has ended
                status = os.waitpid(child, 0)[1]
            line.sendall(struct.pack("=i", status))
