"""Playing libraries in a process that may crash or hang, each in one of its own."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import fmpy.fmi2
import fmpy.fmi3  # noqa: F401 - once, not in each of the processes

from lumbar.base.child import MEMORY, SECONDS
from lumbar.base.confined import answered, error_named
from lumbar.base.errors import InputError
from lumbar.tissue.fmu.check.behaviour import first_difference, problems_of
from lumbar.tissue.fmu.check.instance import UnzippedFmu


class PlayError(InputError):
    """A library that does not play, with what it does in a sentence."""


def play_library(*folders: Path) -> list[str]:
    """Return the problems that a library shows which is played, a sentence each; errors as of `played`.

    Parameters
    ----------
    *folders : Path
        Of an unzipped FMU; with a second one the two are compared, up to the first difference.
    """
    try:
        return played(partial(problems_played, *folders), *folders)
    except PlayError as error:
        return [str(error)]


def played(play: Callable[[], Any], *folders: Path, kinds: tuple[type, ...] = ()) -> Any:
    """Return what a function returns that plays the libraries in these folders, called in a child process.

    It has the limits of a reader of files (`lumbar.base.child`): it reads what lies in these folders, and writes nothing.

    Parameters
    ----------
    play, kinds
        As of `lumbar.base.confined.confined`.

    Raises
    ------
    PlayError
        The library crashes, does not come back, or takes too much.
    InputError
        What `play` raises; or the check itself fails.
    """
    kind, found = answered(partial(_called, play), list(folders), kinds)
    if kind == "value":
        return found
    if kind == "late":
        raise PlayError(f"the library does not come back within {SECONDS} s; it must play a push in a second")
    if kind == "memory":
        raise PlayError(f"the library takes more memory than {MEMORY / 1e6:.0f} MB; it must play")
    if kind == "ended" and found == "SIGKILL":  # which no library sends to itself
        raise InputError("the check was killed from outside, as where memory runs out; check again")
    if kind == "ended" and isinstance(found, str):
        raise PlayError(f"the library crashes with {found}; it must play")
    if kind == "ended":
        raise PlayError("the library ends the program that plays it; it must play")
    if kind in ("defect", "forged"):
        raise InputError(f"the check itself failed:\n{found[1] if kind == 'defect' else found}")
    raise error_named(kind)(found)


def _called(play: Callable[[], Any]) -> Any:
    """Call what plays; of this module, which knows what players need."""
    return play()


def problems_played(*folders: Path) -> list[str]:
    """The same in this process, which a library may end."""
    fmus = [UnzippedFmu(folder) for folder in folders]
    return problems_of(*fmus) if len(fmus) == 1 else first_difference(*fmus)
