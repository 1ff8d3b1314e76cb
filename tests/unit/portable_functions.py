"""The C library's elementary functions for expressions in Python: the same trees on the same arithmetic."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

import lumbar.tissue.fmu.c
from lumbar.tissue.fmu.build.compiler import compile_library
from lumbar.tissue.models.evaluation import NUMPY

_OF_ONE = ("expm1", "decay", "tanh", "sinh", "arctan", "softplus", "sine", "cosine", "log")
NEGLIGIBLE = 1e-200
"""Numbers below this are flushed to zero, as in ``sampled_force.c``."""


def _elementwise(function, operands: int):
    return lambda *given: np.asarray(np.frompyfunc(function, operands, 1)(*given), dtype=float)


def portable_functions(folder: Path, cache: Path) -> dict:
    """What computes each operation of `lumbar.tissue.models.printing.portable`.

    Elementary functions are compiled from ``portable_math.c``; sums, products, roots and comparisons are exact in NumPy too.
    """
    names = [f"portable_{name}" for name in _OF_ONE]
    lines = ['#include "effect_forms.h"', '#include "portable_math.c"']
    visible = '__attribute__((visibility("default")))'
    for name in (*names, "phi1", "smoothstep"):
        lines.append(f"{visible} double exported_{name}(double x) {{ return {name}(x); }}")
    lines.append(
        f"{visible} double exported_portable_power(double x, double n) {{ return portable_power(x, n); }}"
    )
    for file in ("portable_math.c", "portable_math.h", "effect_forms.h", "model.h"):
        (folder / file).write_text((lumbar.tissue.fmu.c.FOLDER / file).read_text())
    (folder / "model_size.h").write_text("#define MODEL_RINGS 0\n#define MODEL_RING 0\n")
    (folder / "exported_math.c").write_text("\n".join(lines) + "\n")
    library = folder / "math.so"
    compile_library([folder / "exported_math.c"], library, "x86_64-linux", cache)
    loaded = ctypes.CDLL(str(library))
    functions = {
        **NUMPY, "fabs": np.abs, "sqrt": np.sqrt, "smaller": np.minimum, "larger": np.maximum, "clipped": np.clip,
    }  # fmt: skip
    for name in (*names, "phi1", "smoothstep", "portable_power"):
        function = getattr(loaded, f"exported_{name}")
        operands = 2 if name == "portable_power" else 1
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * operands
        functions[name] = _elementwise(function, operands)
    return functions
