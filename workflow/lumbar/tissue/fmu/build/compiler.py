"""Compiling an FMU's shared library for any target, with the C compiler of the ziglang package."""

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from platform import machine, system

from lumbar.base.errors import InputError, did_you_mean
from lumbar.base.yaml_file import shipped_yaml


@dataclass(frozen=True)
class Target:
    """A platform."""

    triple: str
    """Zig's name of it, with the oldest C library supported."""
    suffix: str
    """Of a shared library."""
    fmi2: str
    fmi3: str
    """`fmi2`, `fmi3`: folder below ``binaries/``. FMI 2.0 names processors of 64 bits x86_64 alone: others have FMI 3.0's
    names."""
    libraries: tuple[str, ...] = ()
    """Linker options."""


_SAID = shipped_yaml(Path(__file__).with_suffix(".yaml"))
TARGETS = {
    name: Target(**{key: tuple(value) if isinstance(value, list) else value for key, value in said.items()})
    for name, said in _SAID["targets"].items()
}
"""Platforms that FMUs can be built for."""
_LINES_OF_THE_COMPILER = 30
"""Kept of what it says when it fails: the last lines name the error."""
HOST = "host"
"""The platform of this machine."""

FLAGS: tuple[str, ...] = tuple(_SAID["flags"])


def cache_folder(folder: str | None) -> Path:
    """Return the compiler's cache: the folder given, or one below the user's folder for caches.

    That is ``XDG_CACHE_HOME``, ``LOCALAPPDATA`` on Windows, ``~/.cache`` elsewhere.
    """
    if folder is not None:
        return Path(folder)
    user = os.environ.get("LOCALAPPDATA" if system() == "Windows" else "XDG_CACHE_HOME")
    return (Path(user) if user else Path.home() / ".cache") / "lumbar" / "zig"


def host_target() -> str:
    """Return the target of this machine.

    Raises
    ------
    InputError
        There is no target for it.
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
    """Return the targets in their order in `TARGETS`, ``"host"`` replaced by this machine's.

    Raises
    ------
    InputError
        A target is not known, or there is none.
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
    """Let the compiler build what it needs of each target, where it has not yet, and say so on standard error.

    A few lines are compiled for every target; a file beside the compiler's own says that this was done.

    Raises
    ------
    InputError
        As `compile_library`.
    """
    with tempfile.TemporaryDirectory(prefix="lumbar-warm-") as name:
        source = Path(name) / "warm.c"
        # Exported, so that no linker is left with an empty library: Zig's for macOS crashes on one.
        source.write_text(
            "#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n"
            '__attribute__((visibility("default"))) double rounded_down(double x) { return floor(x); }\n'
        )
        for target in resolve_targets(targets):
            done = cache / f"{target}-{_toolchain()}.ready"
            if not done.is_file():
                duration = "a minute or more" if target.endswith("windows") else "seconds"
                print(
                    f"C compiler: building what it needs of {target} in {cache}, once: {duration}",
                    file=sys.stderr,
                    flush=True,
                )
                compile_library([source], source.with_suffix(TARGETS[target].suffix), target, cache)
                done.touch()


def _toolchain() -> str:
    """What decides whether the compiler must build its libraries anew, in a few letters."""
    try:
        compiler = version("ziglang")
    except PackageNotFoundError:
        compiler = ""
    return hashlib.sha256("\0".join([compiler, *FLAGS]).encode()).hexdigest()[:12]


def compile_library(sources: list[Path], library: Path, target: str, cache: Path) -> None:
    """Compile C sources, all in one folder with their headers, into a shared library for one of `TARGETS`.

    Raises
    ------
    InputError
        The compiler is not installed, its cache cannot be written, or it refuses the sources.
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
    platform = TARGETS[target]
    command = [
        str(Path(package.origin).with_name("zig")),
        "cc",
        "-target",
        platform.triple,
        *FLAGS,
        "-shared",
        "-fPIC",
    ]
    # Names relative to the sources' folder: no path of this machine can enter the library.
    command += [source.name for source in sources]
    command += [*platform.libraries, "-o", library.name]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(
        command, cwd=library.parent, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode or not library.is_file():
        said = "\n".join(done.stderr.strip().splitlines()[-_LINES_OF_THE_COMPILER:]) or "(it said nothing)"
        raise InputError(
            f"compiling for {target} failed (exit code {done.returncode}); where the compiler's words do not help, "
            f"remove its cache {cache} and try again. It said:\n{said}"
        )


@lru_cache(maxsize=64)
def library_of(
    sources: tuple[tuple[str, bytes], ...], listed: tuple[str, ...], name: str, target: str, cache: Path
) -> bytes:
    """Library of these sources; a process that judges a model before it exports it does not build it twice.

    Parameters
    ----------
    sources : tuple of tuple
        Name and contents of each C file and header.
    listed : tuple of str
        Names of the C files to compile, in their order.

    Raises
    ------
    InputError
        No room for the sources, or as `compile_library`.
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
