"""C code of models as programs and as functions that Python calls, the elementary functions too."""

import ctypes
import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest

import lumbar.tissue.fmu.c
from lumbar.tissue.fmu.build.compiler import TARGETS, compile_library
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.sources import C_FILES, source_files
from lumbar.tissue.models.algebra import NUMPY

ON_LINUX = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="runs x86_64 Linux code: use such a machine"
)
WINE = (
    shutil.which("wine64") or shutil.which("wine") or next(iter(Path("/usr/lib/wine").glob("wine64")), None)
)
with_wine = pytest.mark.skipif(WINE is None, reason="no Wine: apt-get install wine64")
_DOUBLE = ctypes.POINTER(ctypes.c_double)
_NUMBERS = itertools.count()


def zig_cc(arguments: list[str], folder: Path, cache: Path) -> None:
    """Run the C compiler in a folder."""
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    command = [sys.executable, "-m", "ziglang", "cc", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def loader_program(source: Path, target: str, folder: Path, cache: Path) -> Path:
    """Compile one C file that loads FMUs into a program for a target."""
    suffix = ".exe" if target.endswith("windows") else ""
    headers = Path(fmpy.__file__).parent / "c-code"
    program = folder / f"{source.stem}{suffix}"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-I", str(headers)]
    libraries = [] if target.endswith("windows") else ["-ldl", "-lm", "-lpthread"]
    options = ["-target", TARGETS[target].triple, *flags, str(source), *libraries, "-o", str(program)]
    zig_cc(options, folder, cache)
    return program


def compile_object(source: Path, target: str, folder: Path, cache: Path) -> Path:
    """Compile one C file for a target, with warnings as errors."""
    flags = ["-std=c99", "-c", "-Wall", "-Wextra", "-Werror", "-target", TARGETS[target].triple]
    zig_cc([*flags, str(source), "-o", f"{source.stem}.o"], folder, cache)
    return folder / f"{source.stem}.o"


def library_path(fmu: Path, target: str) -> Path:
    """Return the place of the library for a target in an unzipped FMU for FMI 3.0."""
    platform, (source, *_) = TARGETS[target], (fmu / "binaries").glob("*/*")
    return fmu / "binaries" / platform.fmi3 / f"{source.stem}{platform.suffix}"


def add_library(fmu: Path, target: str, cache: Path) -> None:
    """Compile the sources of an unzipped FMU for one more target."""
    path = library_path(fmu, target)
    path.parent.mkdir()
    library = fmu / "sources" / path.name
    compile_library([library.parent / name for name in C_FILES], library, target, cache)
    shutil.move(library, path)


def write_sources(model: ExportModel, folder: Path) -> list[str]:
    """Write a model's C sources and return the names of those to compile."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in source_files(model).items():
        (folder / name).write_text(text)
    return list(C_FILES)


class CModel:
    """The C function of a model's sample, called sample by sample as ``sampled_force.c`` does."""

    def __init__(self, model: ExportModel, folder: Path, cache: Path):
        write_sources(model, folder)
        exported = folder / "exported.c"
        exported.write_text(
            '#include "model.h"\n__attribute__((visibility("default")))\n'
            "double exported_sample(double x[], double u, double next[]) {\n"
            "    static model_past past; /* of one simulation from rest */\n"
            "    double y = model_sample(x, &past, u, next);\n"
            "    model_keep(x, next, &past);\n    return y;\n}\n"
            '__attribute__((visibility("default"))) int exported_states(void) { return MODEL_STATES; }\n'
        )
        # A name of its own: a library that was loaded once is not loaded anew.
        library = folder / f"{model.identifier}_{next(_NUMBERS)}.so"
        compile_library([folder / model.dynamics.c_source, exported], library, "x86_64-linux", cache)
        self.library = ctypes.CDLL(str(library))
        self.library.exported_sample.restype = ctypes.c_double
        self.library.exported_sample.argtypes = [_DOUBLE, ctypes.c_double, _DOUBLE]
        self.states = self.library.exported_states()

    def response(self, inputs) -> np.ndarray:
        """Return the output for deviations of the input, from rest."""
        state, following = (ctypes.c_double * self.states)(), (ctypes.c_double * self.states)()
        outputs = np.empty(len(inputs))
        for k, value in enumerate(inputs):
            outputs[k] = self.library.exported_sample(state, value, following)
            for i in range(self.states):
                state[i] = 0.0 if abs(following[i]) < 1e-200 else following[i]
        self.state = list(state)
        return outputs


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


CLIENT = Path(__file__).parent / "fmu_client.c"


DAMPING = 2.75
"""N s/m, half of that of a stylus."""


def energies(client, model, folder, steps: int, gain: float = 0.0) -> list[float]:
    """Least energies in FMI 2.0, with forces displayed at once and late, and in FMI 3.0's event mode, in J; work done."""
    fmu = folder / f"{model.identifier}_unzipped"
    fmpy.extract(str(folder / f"{model.name}_fmi3.fmu"), str(fmu))
    token = fmpy.read_model_description(str(fmu)).instantiationToken
    library = library_path(fmu, "x86_64-linux")
    unit = model.units.position * model.resistance
    command = [client, "passive", library, token, steps, model.sampling_time, unit, DAMPING, gain]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]
