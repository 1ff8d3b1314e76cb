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
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from lumbar.base.child import answer_and_end, received

_PACKAGES = ("pandas", "scipy.io", "h5py", "openpyxl")
_ENDED, _FAILED = b"e", b"f"
"""What the template is told once there is an answer, or none, whose status it is to tell."""
_SIZE = struct.Struct("=Q")
"""Before what is pickled."""
_one_at_a_time = threading.Lock()
_templates: dict[int, tuple[socket.socket, subprocess.Popen]] = {}
"""The line to the template and itself, by the process that started it: a fork of that has none."""


def start(*rehearsed: str) -> None:
    """Start the template of this process, unless it has one; forks call `rehearse` of these modules while they wait."""
    with _one_at_a_time:
        _line(rehearsed)


def _line(rehearsed: tuple[str, ...] = ()) -> socket.socket:
    if os.getpid() not in _templates:
        ours, theirs = socket.socketpair()
        code = f"from lumbar.base.child_template import serve; serve({theirs.fileno()}, {rehearsed})"
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
    request, asked = pickle.dumps(parse), pickle.dumps((Path.cwd(), _modules(parse), opened))
    with _one_at_a_time:
        line = _line()
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                socket.send_fds(line, [_SIZE.pack(len(asked))], [theirs.fileno()])
            line.sendall(asked)
            with contextlib.suppress(ConnectionError):  # it was ended, as its status tells
                ours.sendall(_SIZE.pack(len(request)))
                ours.sendall(request)
            answer, late = received(ours.fileno())
            line.sendall(_FAILED if answer is None else _ENDED)
            return answer, late, struct.unpack("=i", _exactly(line, 4))[0] if answer is None else 0
        except BaseException as error:  # a line on which an answer is left is of no use
            line.close()
            del _templates[os.getpid()]
            if isinstance(error, OSError):
                return None, False, 0
            raise
        finally:
            ours.close()


def _modules(asked: Any) -> set[str]:
    """Modules of a function and of those that it is given."""
    if not isinstance(asked, partial):
        return {asked.__module__} if callable(asked) else set()
    return set().union(*map(_modules, (asked.func, *asked.args, *asked.keywords.values())))


def _exactly(line: socket.socket, size: int) -> bytearray:
    found = bytearray(size)
    place = memoryview(found)
    while place:
        count = line.recv_into(place)
        if not count:
            raise ConnectionError("the other end is gone")
        place = place[count:]
    return found


def serve(number: int, rehearsed: tuple[str, ...]) -> None:
    """Hand every request to a fork; end, with the fork that is at work, when nobody is left to ask.

    A fork that opens no file is made, confined and has rehearsed before it is asked for: that takes longer than most files. What
    it writes to is copied then, a page at a time: the first file that a fork reads takes some times as long as the next.
    """
    for number_of_signal in (signal.SIGINT, signal.SIGTERM):  # which a terminal sends to all
        signal.signal(number_of_signal, signal.SIG_IGN)
    for package in _PACKAGES:
        with contextlib.suppress(ImportError):
            import_module(package)
    line = socket.socket(fileno=number)
    rehearsals = [import_module(module).rehearse for module in rehearsed]
    for rehearse in rehearsals:  # what it makes is there for all
        rehearse()
    spare = _waiting([], rehearsals)
    with contextlib.suppress(ConnectionError):
        while True:
            head, pipes, *_ = socket.recv_fds(line, _SIZE.size, 1)
            if not head:
                return
            folder, modules, opened = pickle.loads(_exactly(line, *_SIZE.unpack(head)))
            if not modules <= sys.modules.keys():  # which a fork that is confined might not import
                for module in modules:
                    import_module(module)
                spare[1].close()
                os.waitpid(spare[0], 0)
                spare = _waiting([], rehearsals)
            if opened:
                with contextlib.suppress(OSError):  # what is named from elsewhere is read all the same
                    os.chdir(folder)
            child, handing = _waiting(opened, []) if opened else spare
            with handing, contextlib.suppress(ConnectionError):  # it was ended, as its status tells
                socket.send_fds(handing, [b"a"], pipes)
            os.close(pipes[0])
            try:
                failed = _exactly(line, 1) == _FAILED
            finally:
                os.kill(child, signal.SIGKILL)  # without effect on one that has ended
                status = os.waitpid(child, 0)[1]
            if failed:
                line.sendall(struct.pack("=i", status))
            if not opened:
                spare = _waiting([], rehearsals)


def _waiting(opened: list[Path], rehearsals: list[Callable[[], None]]) -> tuple[int, socket.socket]:
    """A fork that opens these files alone and waits for a request, and the line to it."""
    ours, theirs = socket.socketpair()
    child = os.fork()
    if not child:
        answer_and_end(partial(_handed, theirs, rehearsals), theirs.fileno(), opened)
    theirs.close()
    return child, ours


def _handed(line: socket.socket, rehearsals: list[Callable[[], None]]) -> tuple[Callable[[], Any], int]:
    """What a fork that waited is asked for, and where to answer."""
    for rehearse in rehearsals:
        rehearse()
    (asking,) = socket.recv_fds(line, 1, 1)[1]
    line.close()
    with socket.socket(fileno=os.dup(asking)) as request:
        return pickle.loads(_exactly(request, *_SIZE.unpack(_exactly(request, _SIZE.size)))), asking
