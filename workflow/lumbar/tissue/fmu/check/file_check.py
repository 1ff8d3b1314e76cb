"""Checking one FMU file by itself: what it says, what its library does, and what its sources give."""

from __future__ import annotations

import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from lumbar.base.errors import InputError, Problems
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.build.compiler import TARGETS, host_target, library_of
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.check.agreement import hold_together
from lumbar.tissue.fmu.check.lint import open_fmu
from lumbar.tissue.fmu.check.playing import play_libraries, waiting_player
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_entry import Catalogues
from lumbar.tissue.models.structure import Structure


@dataclass(frozen=True)
class FileCheck:
    """What was found in one file."""

    path: Path
    problems: tuple[str, ...]
    """One sentence each: variable or file in the FMU, what was found, what is expected."""
    played: bool = False
    """Whether there was a library for this machine to play; only then was it built anew from the sources."""
    same_bytes: bool = False
    """Whether the library built from the sources is the shipped one to the byte; else its forces are."""
    left_out: str = ""
    """What it says that could not be held together, and why."""
    signed_with: str = ""
    """Key that it was signed with, where that was asked."""

    def __str__(self) -> str:
        """One line for a sound file."""
        found = "sound as a file; it has no library for this machine to play"
        if self.played:
            built = "the same library" if self.same_bytes else "a library of the same forces"
            found = f"sound; plays its reference, and its sources give {built}"
        signed = f"signed with {self.signed_with}" if self.signed_with else ""
        return f"{self.path.name}: {'; '.join(filter(None, (found, self.left_out, signed)))}"


def check_file(path: Path, cache: Path) -> FileCheck:
    """Check an FMU: each file by itself, then, where these are sound, all that it says, its library and its sources.

    Parameters
    ----------
    cache : Path
        Folder of the compiler's cache.

    Raises
    ------
    InputError
        The file is not there, or there is no compiler.
    """
    return check_each([path], cache)[0]


def check_each(
    paths: list[Path], cache: Path, catalogues: Catalogues = CATALOGUES, built_anew: bool = True
) -> list[FileCheck]:
    """Check files as `check_file` does; what is slow to start is started once for all.

    Parameters
    ----------
    catalogues : mapping
        Effects of every system that the models may have.
    built_anew : bool
        Whether the library is held to the sources beside it: not where it has just been made of them.
    """
    for path in paths:
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    opened = [open_fmu(path) for path in paths]
    libraries = [None if problems else _library(files) for files, problems in opened]
    with tempfile.TemporaryDirectory(prefix="lumbar-check-") as name:
        work = Path(name)
        with waiting_player() if any(libraries) else nullcontext() as player:
            checks = [_said(path, *found, catalogues) for path, found in zip(paths, opened, strict=True)]
            sound = [
                number for number, check in enumerate(checks) if libraries[number] and not check.problems
            ]
            for number in sound:
                with zipfile.ZipFile(paths[number]) as archive:
                    archive.extractall(work / f"shipped-{number}")
            found = play_libraries([(work / f"shipped-{number}",) for number in sound], work, player)
        for number, problems in zip(sound, found, strict=True):
            checks[number] = replace(checks[number], problems=tuple(problems), played=True)
            if built_anew and not problems:
                library = work / f"shipped-{number}" / str(libraries[number])
                checks[number] = _built_anew(checks[number], work, number, library, cache)
    return checks


def _said(path: Path, files: dict[str, bytes], problems: list[str], catalogues: Catalogues) -> FileCheck:
    """What can be told of a file without running anything in it."""
    problems = problems or _validated(path)
    if problems:
        return FileCheck(path, tuple(problems))
    said = hold_together(files, catalogues)
    return FileCheck(path, said.problems, left_out=said.left_out)


def _built_anew(check: FileCheck, work: Path, number: int, library: Path, cache: Path) -> FileCheck:
    """The check with what the FMU's own sources give: the same bytes, or the same forces."""
    shipped, folder = work / f"shipped-{number}", work / f"built-{number}"
    try:
        built = _built(shipped, library, folder, cache)
    except InputError as error:
        return replace(check, problems=(f"sources: {error}",))
    if built.read_bytes() == library.read_bytes():
        return replace(check, same_bytes=True)
    return replace(check, problems=tuple(play_libraries([(shipped, folder)], work)[0]))


def check_files(
    paths: Iterable[Path], cache: Path, catalogues: Catalogues = CATALOGUES, built_anew: bool = True
) -> list[FileCheck]:
    """Check FMUs and raise one error with all problems of all of them; parameters as of `check_each`."""
    checks = check_each(list(paths), cache, catalogues, built_anew)
    wrong = [check for check in checks if check.problems]
    problems = Problems(wrong[0].path.name if len(wrong) == 1 else "FMUs that must not be used")
    for check in wrong:
        for text in check.problems:
            problems.add("" if len(wrong) == 1 else check.path.name, text)
    problems.raise_if_any()
    return checks


def check_new_files(paths: list[Path], models: Iterable[ExportModel], cache: Path) -> None:
    """Check files that were just written of these models, and remove them all where one has a problem."""
    structures = [model.identified.structure for model in models]
    forms = [form for item in structures if isinstance(item, Structure) for form in item.forms]
    own = {form.effect: Effect(form.effect, "", (form,), "") for form in forms if not form.definition}
    try:
        check_files(paths, cache, dict.fromkeys(CATALOGUES, own), built_anew=False)
    except InputError:
        for path in paths:
            path.unlink()
        raise


def _validated(path: Path) -> list[str]:
    """Problems that fmpy finds by the standard's schema; a file that it cannot read is one."""
    from fmpy.validation import validate_fmu

    try:
        return [f"modelDescription.xml: {text}" for text in validate_fmu(str(path))]
    except Exception as error:  # fmpy raises plain ones with the schema's words
        return [f"modelDescription.xml: {error}"]


def _library(files: Iterable[str]) -> str | None:
    """Path in the archive of the library for this machine."""
    try:
        target = TARGETS[host_target()]
    except InputError:
        return None  # a platform that FMUs are not built for
    folders = tuple(f"binaries/{name}/" for name in (target.fmi2, target.fmi3))
    return next((name for name in files if name.startswith(folders) and name.endswith(target.suffix)), None)


def _built(shipped: Path, library: Path, folder: Path, cache: Path) -> Path:
    """Build the library from the FMU's own sources into a copy of the FMU without them."""
    shutil.copytree(shipped, folder, ignore=shutil.ignore_patterns("sources", "binaries", "documentation"))
    built = folder / "binaries" / library.parent.name / library.name
    built.parent.mkdir(parents=True)
    # buildDescription.xml is FMI 3.0's alone and nothing to compile.
    files = sorted(file for file in (shipped / "sources").iterdir() if file.suffix != ".xml")
    sources = tuple((file.name, file.read_bytes()) for file in files)
    built.write_bytes(library_of(sources, _listed(shipped), library.name, host_target(), cache))
    return built


def _listed(folder: Path) -> tuple[str, ...]:
    """C files that the FMU says it is built of, in its order."""
    build = folder / "sources" / "buildDescription.xml"
    if build.is_file():
        names = [item.get("name", "") for item in ElementTree.parse(build).iter("SourceFile")]
    else:
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        names = [item.get("name", "") for item in root.iterfind("CoSimulation/SourceFiles/File")]
    return tuple(names)
