"""Compiling an FMU's shared library for any target, with the C compiler of the ziglang package."""

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from platform import machine, system

from lumbar.base.errors import InputError, did_you_mean


@dataclass(frozen=True)
class Target:
    """A platform for which the library of an FMU is compiled."""

    triple: str
    """Zig's name of the platform, with the oldest C library supported."""
    suffix: str
    """Ending of a shared library."""
    fmi2: str
    """Folder below ``binaries/`` in an FMU of FMI 2.0. FMI 2.0 defines folder names only for x86_64; other processors use the
    FMI 3.0 name."""
    fmi3: str
    """Folder below ``binaries/`` in an FMU of FMI 3.0."""
    libraries: tuple[str, ...] = ()
    """Linker options for this platform."""


TARGETS = {
    "x86_64-linux": Target("x86_64-linux-gnu.2.17", ".so", "linux64", "x86_64-linux", ("-lm",)),
    "x86_64-windows": Target("x86_64-windows-gnu", ".dll", "win64", "x86_64-windows"),
    "aarch64-linux": Target("aarch64-linux-gnu.2.17", ".so", "aarch64-linux", "aarch64-linux", ("-lm",)),
    "x86_64-darwin": Target("x86_64-macos", ".dylib", "darwin64", "x86_64-darwin"),
    "aarch64-darwin": Target("aarch64-macos", ".dylib", "aarch64-darwin", "aarch64-darwin"),
}
"""Platforms that FMUs can be built for."""
_ERROR_LINES = 30
"""Number of last lines of the compiler's output in an error message: the last lines name the cause."""
HOST = "host"
"""Name of this machine's platform in the settings."""
FLAGS = (
    *("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"),
    # The same rounding on every platform.
    *("-ffp-contract=off", "-fno-fast-math", "-fno-sanitize=undefined"),
    # No paths, dates and names of the build machine: every build of a model is the same file. Without -flto, which Zig links
    # for Linux only, and which is not measurably faster: sampled_force.c includes the model.
    *("-fvisibility=hidden", "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-g0", "-s"),
)


def cache_folder(folder: str | None) -> Path:
    """Return the compiler's cache: the given folder, or one below ``XDG_CACHE_HOME``, ``LOCALAPPDATA`` or ``~/.cache``."""
    if folder is not None:
        return Path(folder)
    user = os.environ.get("LOCALAPPDATA" if system() == "Windows" else "XDG_CACHE_HOME")
    return (Path(user) if user else Path.home() / ".cache") / "lumbar" / "zig"


def host_target() -> str:
    """Return the target of this machine.

    Raises
    ------
    InputError
        If this machine has no target.
    """
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine().lower(), machine().lower())
    name = f"{processor}-{system().lower()}"
    if name not in TARGETS:
        raise InputError(
            f"runtime.targets: this machine is {name!r}, which FMUs cannot be built for; name targets of "
            f"{', '.join(TARGETS)}"
        )
    return name


def resolve_targets(names: Sequence[str]) -> list[str]:
    """Return the targets in the order of `TARGETS`; ``"host"`` becomes the target of this machine.

    Raises
    ------
    InputError
        If a target is unknown, or no target is given.
    """
    unknown = [name for name in names if name not in (*TARGETS, HOST)]
    if unknown or not names:
        meant = did_you_mean(unknown[0], TARGETS) if unknown else ""
        raise InputError(
            f"runtime.targets: {', '.join(unknown) or 'empty'}{meant}; allowed are {HOST}, {', '.join(TARGETS)}"
        )
    wanted = {host_target() if name == HOST else name for name in names}
    return [name for name in TARGETS if name in wanted]


def warm_cache(targets: Sequence[str], cache: Path) -> None:
    """Let the compiler build its own libraries for each target not yet in the cache, and report this on standard error.

    A few lines of C are compiled for each of these targets; a file in the cache marks the target as done.

    Raises
    ------
    InputError
        In the cases of `compile_library`.
    """
    compiler = version("ziglang") if find_spec("ziglang") else ""
    # Compiler and flags decide whether the libraries must be built again.
    toolchain = hashlib.sha256("\0".join([compiler, *FLAGS]).encode()).hexdigest()[:12]
    with tempfile.TemporaryDirectory(prefix="lumbar-warm-") as name:
        source = Path(name) / "warm.c"
        # The function is exported because Zig's linker for macOS crashes on an empty library.
        source.write_text(
            "#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n"
            '__attribute__((visibility("default"))) double rounded_down(double x) { return floor(x); }\n'
        )
        for target in resolve_targets(targets):
            done = cache / f"{target}-{toolchain}.ready"
            if not done.is_file():
                duration = "a minute or more" if target.endswith("windows") else "seconds"
                print(
                    f"C compiler: building its libraries for {target} in {cache}, once: {duration}",
                    file=sys.stderr,
                    flush=True,
                )
                compile_library([source], source.with_suffix(TARGETS[target].suffix), target, cache)
                done.touch()


def compile_library(sources: list[Path], library: Path, target: str, cache: Path) -> None:
    """Compile C sources, all in one folder with their headers, into a shared library for one of `TARGETS`.

    Raises
    ------
    InputError
        If the compiler is not installed, its cache cannot be written, or it rejects the sources.
    """
    package = find_spec("ziglang")
    if package is None or package.origin is None:
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
    platform, zig = TARGETS[target], str(Path(package.origin).with_name("zig"))
    # Names relative to the sources' folder: no path of this machine can enter the library.
    files = [*(source.name for source in sources), *platform.libraries, "-o", library.name]
    command = [zig, "cc", "-target", platform.triple, *FLAGS, "-shared", "-fPIC", *files]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(
        command, cwd=library.parent, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode or not library.is_file():
        output = "\n".join(done.stderr.strip().splitlines()[-_ERROR_LINES:]) or "(no output)"
        raise InputError(
            f"compiling for {target} failed (exit code {done.returncode}); if the compiler's output does not help, "
            f"remove its cache {cache} and try again. Its output:\n{output}"
        )


@lru_cache(maxsize=64)
def compile_sources(
    sources: tuple[tuple[str, bytes], ...], listed: tuple[str, ...], name: str, target: str, cache: Path
) -> bytes:
    """Return the library of C sources; each process compiles the same sources only once.

    `sources` are name and contents of each C file and header, `listed` the names of the C files in their order; `name`,
    `target` and `cache` are the file name of the library, one of `TARGETS`, and the folder of the compiler's cache.

    Raises
    ------
    InputError
        If the sources cannot be written, and in the cases of `compile_library`.
    """
    with tempfile.TemporaryDirectory(prefix="lumbar-fmu-") as folder:
        try:
            for file, content in sources:
                (Path(folder) / file).write_bytes(content)
        except OSError as error:
            raise InputError(
                f"{folder}: sources cannot be written there for the compiler ({error.strerror}); let TMPDIR name a folder "
                "with free space"
            ) from error
        library = Path(folder) / name
        compile_library([Path(folder) / file for file in listed], library, target, cache)
        return library.read_bytes()
