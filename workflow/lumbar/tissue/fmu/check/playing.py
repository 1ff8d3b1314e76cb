"""Playing libraries in a process that may crash or hang, each in one of its own."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import fmpy.fmi2
import fmpy.fmi3  # noqa: F401 - once, not in each of the processes

from lumbar.base.child import MEMORY, SECONDS
from lumbar.base.confined import answered
from lumbar.base.errors import InputError
from lumbar.tissue.fmu.check.behaviour import first_difference, problems_of
from lumbar.tissue.fmu.check.instance import UnzippedFmu


def play_library(*folders: Path) -> list[str]:
    """Return the problems that a library shows which is played, a sentence each.

    It has the limits of a reader of files (`lumbar.base.child`): it reads what lies in these folders, and writes nothing.

    Parameters
    ----------
    *folders : Path
        Of an unzipped FMU; with a second one the two are compared, up to the first difference.

    Raises
    ------
    InputError
        The check itself fails.
    """
    kind, found = answered(partial(problems_played, *folders), list(folders))
    if kind == "value":
        return found
    if kind == "late":
        return [f"the library does not come back within {SECONDS} s; it must play a push in a second"]
    if kind == "memory":
        return [f"the library takes more memory than {MEMORY / 1e6:.0f} MB; it must play"]
    if kind == "ended" and found == "SIGKILL":  # which no library sends to itself
        raise InputError("the check was killed from outside, as where memory runs out; check again")
    if kind == "ended" and isinstance(found, str):
        return [f"the library crashes with {found}; it must play"]
    if kind == "ended":
        return ["the library ends the program that plays it; it must play"]
    raise InputError(f"the check itself failed:\n{found[1] if kind == 'defect' else found}")


def problems_played(*folders: Path) -> list[str]:
    """The same in this process, which a library may end."""
    fmus = [UnzippedFmu(folder) for folder in folders]
    return problems_of(*fmus) if len(fmus) == 1 else first_difference(*fmus)
