"""The runs of `make test-portable`: a star, one thing changed at a time from this machine's own way.

Kernels are OpenBLAS's, chosen by ``OPENBLAS_CORETYPE``; the instructions that NumPy itself picks at start are taken
away by ``NPY_DISABLE_CPU_FEATURES``. Some names share one kernel in the wheels of NumPy and SciPy (Zen has
Haswell's): the report says which kernel was really used.
"""

from __future__ import annotations

import platform
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path

CENTRE = "as it is"
PYTHONS = ("3.11", "3.12", "3.13")
KERNELS = {
    "Prescott": {"pni"},
    "Haswell": {"avx2", "fma"},
    "Zen": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl", "avx512cd"},
}
"""What the processor must offer for each, in the words of /proc/cpuinfo."""


@dataclass(frozen=True)
class Run:
    """One point of the star.

    Attributes
    ----------
    name : str
    kind : str
        What is changed: ``kernel``, ``threads``, ``python`` or ``dependencies``.
    variables : dict of str to str
        Of the environment.
    threads : int
        Of the linear algebra.
    python : Path
        Interpreter that makes the run's environment.
    packages : str
        ``present`` (of the interpreter that runs this), ``locked``, ``lowest`` or ``newest``.
    obstacle : str
        Why it cannot be run here; empty where it can.
    """

    name: str
    kind: str
    variables: dict[str, str] = field(default_factory=dict)
    threads: int = 1
    python: Path = Path(sys.executable)
    packages: str = "present"
    obstacle: str = ""


def star(interpreters: list[Path]) -> list[Run]:
    """Return all runs, the centre first.

    Parameters
    ----------
    interpreters : list of Path
        Pythons beside those on the PATH, named as the user named them.
    """
    flags = processor_flags()
    runs = [Run(CENTRE, "centre")]
    runs += [
        Run(name, "kernel", {"OPENBLAS_CORETYPE": name}, obstacle=_lacking(name, flags)) for name in KERNELS
    ]
    runs.append(Run("NumPy's baseline", "kernel", {"NPY_DISABLE_CPU_FEATURES": " ".join(numpy_features())}))
    runs.append(Run("two threads", "threads", threads=2))
    for version in PYTHONS:
        if version == "{}.{}".format(*sys.version_info[:2]):
            continue
        found = interpreter(version, interpreters)
        missing = (
            ""
            if found
            else f"no python{version} on the PATH; name one with --python /path/to/python{version}"
        )
        runs.append(
            Run(f"Python {version}", "python", python=found or Path(), packages="locked", obstacle=missing)
        )
    runs += [
        Run(f"{packages} dependencies", "dependencies", packages=packages)
        for packages in ("lowest", "newest")
    ]
    return runs


def processor_flags() -> set[str]:
    """Return the instruction sets that this processor offers; empty where nobody says."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.is_file() else []
    return next((set(line.split()) for line in lines if line.startswith("flags")), set())


def _lacking(kernel: str, flags: set[str]) -> str:
    if platform.machine() not in ("x86_64", "AMD64"):
        return f"this processor is of kind {platform.machine()}; {kernel} is a kernel for x86_64"
    if not flags:
        return "this system does not say what its processor can (no flags in /proc/cpuinfo)"
    lacking = sorted(KERNELS[kernel] - flags)
    return f"this processor cannot execute it: it has no {', '.join(lacking)}" if lacking else ""


def numpy_features() -> list[str]:
    """Instruction sets that NumPy would choose here beyond those it was built for."""
    import numpy as np

    return np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])


def interpreter(version: str, named: list[Path]) -> Path | None:
    """Return an interpreter of a version: one of those named, or from the PATH."""
    for path in named:
        if f"python{version}" == path.resolve().name or f"/{version}." in str(path):
            return path
    found = shutil.which(f"python{version}")
    return Path(found) if found else None
