"""Prints which kernels and how many threads the OpenBLAS libraries of NumPy and SciPy really use (Linux)."""

import ctypes
from pathlib import Path

import numpy  # noqa: F401 - loads its OpenBLAS
import scipy.linalg  # noqa: F401 - loads another one

NAMES = ("scipy_openblas_get_{}64_", "scipy_openblas_get_{}", "openblas_get_{}64_", "openblas_get_{}")

maps = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
used = set()
for path in {line.split()[-1] for line in maps if "openblas" in line}:
    library = ctypes.CDLL(path)
    for name in NAMES:
        if hasattr(library, name.format("corename")):
            corename = getattr(library, name.format("corename"))
            corename.restype = ctypes.c_char_p
            threads = getattr(library, name.format("num_threads"))()
            used.add(f"{corename().decode()}, {threads} thread{'s' * (threads > 1)}")
            break
print("; ".join(sorted(used)) or "unknown")
