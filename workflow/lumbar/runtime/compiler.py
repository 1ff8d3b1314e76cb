"""Compiling an FMU's shared library for any target, with the C compiler of the ziglang package."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from lumbar.errors import InputError


@dataclass(frozen=True)
class Target:
    """A platform.

    Attributes
    ----------
    triple : str
        Zig's name of it, with the oldest C library supported.
    suffix : str
        Of a shared library.
    fmi2, fmi3 : str
        Folder below ``binaries/``; FMI 2.0 has names of its own.
    libraries : tuple of str
        Linker options.
    """

    triple: str
    suffix: str
    fmi2: str
    fmi3: str
    libraries: tuple[str, ...] = ()


TARGETS = {
    "x86_64-linux": Target("x86_64-linux-gnu.2.17", ".so", "linux64", "x86_64-linux", ("-lm",)),
}
"""Platforms that FMUs can be built for. One more row is all that another platform needs."""

# -ffp-contract=off: the same rounding on every platform. The rest keeps paths, dates and names of the build
# machine out, so that every build of the same model is the same file.
FLAGS = (
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-ffp-contract=off",
    "-fno-fast-math",
    "-fno-sanitize=undefined",
    "-fvisibility=hidden",
    "-g0",
    "-s",
    "-shared",
    "-fPIC",
)


def check_targets(names: list[str]) -> None:
    """Raise `InputError` for a target that is not known."""
    unknown = [name for name in names if name not in TARGETS]
    if unknown or not names:
        raise InputError(f"runtime.targets: {unknown or 'empty'}; allowed are {', '.join(TARGETS)}")


def compile_library(sources: list[Path], library: Path, target: str, cache: Path) -> None:
    """Compile C sources into a shared library.

    Parameters
    ----------
    sources : list of Path
        C files, all in one folder with their headers.
    library : Path
        File to write.
    target : str
        One of `TARGETS`.
    cache : Path
        Folder for the compiler's cache; made where it is absent.

    Raises
    ------
    InputError
        The compiler is not installed, its cache cannot be written, or it refuses the sources.
    """
    if find_spec("ziglang") is None:
        raise InputError(
            "no C compiler: the package ziglang is not installed; install the environment of envs/"
        )
    cache = cache.absolute()
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"runtime.compiler_cache: {cache} cannot be made ({error.strerror}); name another"
        ) from error
    platform = TARGETS[target]
    command = [sys.executable, "-m", "ziglang", "cc", "-target", platform.triple, *FLAGS]
    # Names relative to the sources' folder: no path of this machine can enter the library.
    command += [source.name for source in sources]
    command += [*platform.libraries, "-o", library.name]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(
        command, cwd=library.parent, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode or not library.is_file():
        raise InputError(
            f"compiling for {target} failed (exit code {done.returncode}, cache {cache}):\n"
            f"{done.stderr.strip()}"
        )
