"""``lumbar.check_fmu``: whether an FMU is what it says."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from lumbar.settings.runtime import RuntimeSettings

if TYPE_CHECKING:
    from lumbar.tissue.fmu.check.file_check import FileCheck


def check_fmu(
    path: str | os.PathLike | Iterable[str | os.PathLike], *, settings: RuntimeSettings | None = None
) -> list[FileCheck]:
    """Check FMUs: description, library, reference signals and sources must say and do the same.

    The library in an FMU is a program and is run, as every importer does: check only files that you would run.

    Parameters
    ----------
    path : path or iterable of path
        FMUs of `export_fmu`, of any platform; the library is played, and built anew from the sources in the FMU,
        where it is one for this machine.
    settings : RuntimeSettings, optional
        For the compiler's cache.

    Returns
    -------
    list of FileCheck
        What was checked of each file.

    Raises
    ------
    InputError
        With every problem of every file: the variable or the place, what was found, what is expected.

    Examples
    --------
    >>> import lumbar
    >>> print(*lumbar.check_fmu("fmu/KB_fmi3.fmu"))  # doctest: +SKIP
    KB_fmi3.fmu: sound; plays its reference, and its sources give the same library
    """
    from lumbar.tissue.fmu.build.compiler import cache_folder
    from lumbar.tissue.fmu.check.file_check import check_files

    paths = [path] if isinstance(path, str | os.PathLike) else path
    cache = cache_folder((settings or RuntimeSettings()).compiler_cache)
    return check_files(map(Path, paths), cache)
