"""Linux's Landlock: a process gives up every file, every connection and every signal but what it names first.

The kernel's own description is docs.kernel.org/userspace-api/landlock.html; structures and numbers are those of its header
linux/landlock.h. Where the kernel has none, or on another system, nothing is given up.
"""

import ctypes
import os
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

_CREATE, _ADD_RULE, _RESTRICT = 444, 445, 446
_ASK_VERSION, _PATH_BENEATH = 1, 1
_READ_FILE, _READ_DIR = 1 << 2, 1 << 3
_NO_NEW_PRIVILEGES = 38
_FILES = {1: (1 << 13) - 1, 2: 1 << 13, 3: 1 << 14, 5: 1 << 15}
"""Rights over files by the version that knows them first: execute, write, read, make, remove; refer; truncate; devices."""
_CONNECT, _BIND = 4, 0b11
_SCOPES, _SOCKETS_AND_SIGNALS = 6, 0b11
_libc = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


def version() -> int:
    """Version of Landlock in this kernel; 0 where there is none."""
    return max(_libc.syscall(_CREATE, None, 0, _ASK_VERSION), 0) if _libc else 0


def give_up_files(readable: Iterable[Path]) -> None:
    """Let this process, for good, open no file but these and those below these folders, for reading alone.

    Raises
    ------
    OSError
        If the kernel has Landlock and refuses.
    """
    known = version()
    if not known:
        return
    files = sum(rights for first, rights in _FILES.items() if known >= first)
    asked = [
        files,
        *([_BIND] if known >= _CONNECT else []),
        *([_SOCKETS_AND_SIGNALS] if known >= _SCOPES else []),
    ]
    attributes = struct.pack(f"={len(asked)}Q", *asked)
    rules = _called(_CREATE, attributes, len(attributes), 0)
    for path in readable:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        rights = _READ_FILE | (_READ_DIR if Path(path).is_dir() else 0)
        _called(_ADD_RULE, rules, _PATH_BENEATH, struct.pack("=Qi", rights, place), 0)
        os.close(place)
    assert _libc is not None  # there is a version
    _libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    _called(_RESTRICT, rules, 0)
    os.close(rules)


def _called(*arguments: int | bytes) -> int:
    """Result of a system call."""
    assert _libc is not None
    found = _libc.syscall(*arguments)
    if found < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return found
