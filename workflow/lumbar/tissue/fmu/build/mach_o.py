"""Libraries of several processors in one file, as macOS loads them."""

from __future__ import annotations

import struct

_MAGIC = 0xCAFEBABE
_MACH_O_64 = 0xFEEDFACF
_ALIGNMENT = 14
"""Exponent of 2: pages of 16 KiB, the largest of Apple's processors."""


def universal_library(libraries: list[bytes]) -> bytes:
    """Join Mach-O libraries of 64-bit processors, as Apple's ``lipo`` does (``mach-o/fat.h``).

    Raises
    ------
    ValueError
        If one is not a 64-bit little-endian Mach-O file.
    """
    head = struct.pack(">II", _MAGIC, len(libraries))
    page = 1 << _ALIGNMENT
    body = b""
    for library in libraries:
        magic, processor, variant = struct.unpack_from("<III", library)
        if magic != _MACH_O_64:
            raise ValueError(f"not a 64-bit Mach-O library: it begins with {magic:#x}")
        body += b"\0" * (-len(body) % page)
        head += struct.pack(">IIIII", processor, variant, page + len(body), len(library), _ALIGNMENT)
        body += library
    return head + b"\0" * (page - len(head)) + body
