"""Checking one FMU file by itself: what it says, what its library does where it may crash or hang, what its sources give."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from lumbar.base.errors import InputError, Problems
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.build.compiler import TARGETS, host_target, library_of
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.check import behaviour
from lumbar.tissue.fmu.check.agreement import hold_together
from lumbar.tissue.fmu.check.behaviour import SECONDS, result_file
from lumbar.tissue.fmu.check.lint import open_fmu
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_entry import Catalogues
from lumbar.tissue.models.structure import Structure


@contextmanager
def waiting_player() -> Iterator[subprocess.Popen]:
    """A process that makes itself ready to play while others prepare what; it ends with the block."""
    # The scripts of the workflow find this package by sys.path, which a new process does not inherit.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command, pipe = [sys.executable, "-m", behaviour.__name__], subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment
    ) as player:
        try:
            yield player
        finally:
            player.kill()


def play_libraries(
    jobs: Sequence[tuple[Path, ...]], work: Path, waiting: subprocess.Popen | None = None
) -> list[list[str]]:
    """Return the problems that the libraries of these FMUs show.

    Libraries share a process: starting one costs more than playing a library. A library with which something is wrong ends it,
    and one that failed after others is played again in a process of its own: what the others did cannot be laid at its door.

    Parameters
    ----------
    jobs : sequence of tuple of Path
        Folder of an unzipped FMU; with a second one the two are compared.
    work : Path
        Folder for what the processes find.
    waiting : subprocess.Popen, optional
        A player that nobody has asked yet.

    Returns
    -------
    list of list of str
        One sentence per problem, for each job.

    Raises
    ------
    InputError
        The check itself fails.
    """
    found: dict[int, list[str]] = {}
    for number in range(len(jobs)):
        result_file(work, number).unlink(missing_ok=True)
    while rest := [number for number in range(len(jobs)) if number not in found]:
        asked = {number: [str(folder) for folder in jobs[number]] for number in rest}
        with nullcontext(waiting) if waiting else waiting_player() as player:
            _, said = player.communicate(json.dumps([str(work), asked]))
        waiting = None
        finished = [number for number in rest if result_file(work, number).is_file()]
        for number in finished:
            found[number] = json.loads(result_file(work, number).read_text(encoding="utf-8"))
        if not finished:
            found[rest[0]] = [_failure(player.returncode, said)]
    return [found[number] for number in range(len(jobs))]


def _failure(status: int, said: str) -> str:
    """Why a process ended before its first library had been played."""
    if status < 0:
        if -status == signal.SIGKILL:  # which no library sends to itself
            raise InputError("the check was killed from outside, as where memory runs out; check again")
        return f"the library crashes with signal {-status}; it must play"
    if status and "Timeout (" in said:
        return f"the library does not come back within {SECONDS} s; it must play a push in a second"
    if status == 0:
        return "the library ends the program that plays it; it must play"
    raise InputError(f"the check itself failed:\n{said[-2000:]}")


Files = Mapping[str, bytes]
"""Contents of an FMU by their path in it."""
UNKNOWN = (
    "its library is not the one that this version makes of its record, nobody vouches for it, and it was not run: lumbar check "
    "--key KEY.pub runs what its owner signed, --trust anything"
)


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
    unknown: bool = False
    """Whether there was a library that nobody vouches for, which was not run."""
    signed_with: str = ""
    """Key that it was signed with, where that was asked."""

    def __str__(self) -> str:
        """One line for a sound file."""
        found = (
            f"sound as a file; {UNKNOWN if self.unknown else 'it has no library for this machine to play'}"
        )
        if self.played:
            built = "the same library" if self.same_bytes else "a library of the same forces"
            found = f"sound; plays its reference, and its sources give {built}"
        signed = f"signed with {self.signed_with}" if self.signed_with else ""
        return f"{self.path.name}: {'; '.join(filter(None, (found, self.left_out, signed)))}"


def check_files(
    paths: Sequence[Path],
    cache: Path,
    catalogues: Catalogues = CATALOGUES,
    built_anew: bool = True,
    trust: bool = True,
) -> list[FileCheck]:
    """Check FMUs: each file by itself, then, where these are sound, all that it says, its library and its sources.

    Parameters
    ----------
    cache : Path
        Folder of the compiler's cache.
    catalogues : mapping
        Effects of every system that the models may have.
    built_anew : bool
        Whether the library is held to the sources beside it: not where it has just been made of them.
    trust : bool
        Whether any library is run; else that alone which is, to the byte, what this machine makes of sources that are known.

    Raises
    ------
    InputError
        A file is not there, or there is no compiler.
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
            if not trust:
                for number in sound:
                    files, name = opened[number][0], str(libraries[number])
                    known = not checks[number].left_out and _compiled(files, name, cache) == files[name]
                    checks[number] = replace(checks[number], unknown=not known)
                sound = [number for number in sound if not checks[number].unknown]
            for number in sound:
                with zipfile.ZipFile(paths[number]) as archive:
                    archive.extractall(work / f"shipped-{number}")
            found = play_libraries([(work / f"shipped-{number}",) for number in sound], work, player)
        for number, problems in zip(sound, found, strict=True):
            checks[number] = replace(checks[number], problems=tuple(problems), played=True)
            if built_anew and not problems:
                checks[number] = _built_anew(
                    checks[number],
                    opened[number][0],
                    str(libraries[number]),
                    work / f"shipped-{number}",
                    cache,
                )
    return checks


def _said(path: Path, files: dict[str, bytes], problems: list[str], catalogues: Catalogues) -> FileCheck:
    """What can be told of a file without running anything in it."""
    problems = problems or _validated(path)
    if problems:
        return FileCheck(path, tuple(problems))
    said = hold_together(files, catalogues)
    return FileCheck(path, said.problems, left_out=said.left_out)


def _built_anew(check: FileCheck, files: Files, library: str, shipped: Path, cache: Path) -> FileCheck:
    """The check with what the FMU's own sources give: the same bytes, or the same forces."""
    try:
        built = _compiled(files, library, cache)
    except InputError as error:
        return replace(check, problems=(f"sources: {error}",))
    if built == files[library]:
        return replace(check, same_bytes=True)
    folder = shipped.with_name(f"built-{shipped.name}")
    shutil.copytree(shipped, folder, ignore=shutil.ignore_patterns("sources", "binaries", "documentation"))
    (folder / library).parent.mkdir(parents=True)
    (folder / library).write_bytes(built)
    return replace(check, problems=tuple(play_libraries([(shipped, folder)], shipped.parent)[0]))


def all_sound(checks: list[FileCheck]) -> list[FileCheck]:
    """The checks again, or one error with all problems of all files."""
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
        all_sound(check_files(paths, cache, dict.fromkeys(CATALOGUES, own), built_anew=False))
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


def _compiled(files: Files, library: str, cache: Path) -> bytes:
    """Library for this machine of an FMU's own sources."""
    # buildDescription.xml is FMI 3.0's alone and nothing to compile.
    sources = tuple(
        (name.removeprefix("sources/"), content)
        for name, content in sorted(files.items())
        if name.startswith("sources/") and not name.endswith(".xml")
    )
    return library_of(sources, _listed(files), PurePosixPath(library).name, host_target(), cache)


def _listed(files: Files) -> tuple[str, ...]:
    """C files that the FMU says it is built of, in its order."""
    build = files.get("sources/buildDescription.xml")
    if build is not None:
        found = ElementTree.fromstring(build).iter("SourceFile")
    else:
        found = ElementTree.fromstring(files["modelDescription.xml"]).iterfind(
            "CoSimulation/SourceFiles/File"
        )
    return tuple(item.get("name", "") for item in found)
