"""Checking one FMU file by itself: what it says, what its library does, and what its sources give."""

import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from lumbar.base.errors import InputError, Problems
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.build.compiler import TARGETS, host_target, library_of
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.check.agreement import hold_together
from lumbar.tissue.fmu.check.lint import BROKEN_XML, open_fmu, told
from lumbar.tissue.fmu.check.playing import play_library
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_entry import Catalogues
from lumbar.tissue.models.structure import Structure

Files = Mapping[str, bytes]
"""Contents of an FMU by their path in it."""
UNKNOWN = (
    "its library is not the one that this version makes of its record, nobody vouches for it, and it was not run: lumbar check "
    "--key KEY.pub runs what its owner signed, --trust anything"
)

NO_LIBRARY = "it has no library for this machine to play"


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
        found = f"sound as a file; {UNKNOWN if self.unknown else NO_LIBRARY}"
        if self.played:
            built = "the same library" if self.same_bytes else "a library of the same forces"
            built = "were not compiled" if self.left_out else f"give {built}"
            found = f"sound; plays its reference, and its sources {built}"
        signed = f"signed with {self.signed_with}" if self.signed_with else ""
        return f"{self.path.name}: {'; '.join(filter(None, (found, self.left_out, signed)))}"


def check_files(
    paths: Sequence[Path],
    cache: Path,
    catalogues: Catalogues = CATALOGUES,
    built_anew: bool = True,
    trust: bool = True,
    played: bool = True,
) -> list[FileCheck]:
    """Check FMUs: each file by itself, then, where these are sound, all that it says, its library and its sources.

    Parameters
    ----------
    cache : Path
        Folder of the compiler's cache.
    catalogues : mapping
        Effects of every system that the models may have.
    built_anew : bool
        Whether the library is held to the sources beside it, where these are those of its record: not where it has just been
        made of them.
    trust : bool
        Whether any library is run; else that alone which is, to the byte, what this machine makes of sources that are known.
    played : bool
        Whether libraries are run at all.

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
    checks: list[FileCheck] = []
    with tempfile.TemporaryDirectory(prefix="lumbar-check-") as name:
        work = Path(name)
        for number, (path, found) in enumerate(zip(paths, opened, strict=True)):
            check, files, library = _said(path, *found, catalogues), found[0], libraries[number]
            if library and not check.problems and not trust:
                known = not check.left_out and _compiled(files, library, cache) == files[library]
                check = replace(check, same_bytes=known, unknown=not known)
            if library and played and not check.problems and not check.unknown:
                folder = work / f"shipped-{number}"
                with zipfile.ZipFile(path) as archive:
                    archive.extractall(folder)
                check = replace(check, problems=tuple(play_library(folder)), played=True)
                # Sources that are not those of the record may read files, hold more than there is memory, or name options.
                if built_anew and not (check.problems or check.same_bytes or check.left_out):
                    check = _built_anew(check, files, library, folder, cache)
            checks.append(check)
    return checks


def _said(path: Path, files: dict[str, bytes], problems: list[str], catalogues: Catalogues) -> FileCheck:
    """What can be told of a file without running anything in it."""
    problems = problems or _validated(path)
    if problems:
        return FileCheck(path, told(problems))
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
    return replace(check, problems=tuple(play_library(shipped, folder)))


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
        try:
            found = ElementTree.fromstring(build).iter("SourceFile")
        except BROKEN_XML as error:
            raise InputError(f"sources/buildDescription.xml is no XML: {error}") from error
    else:
        found = ElementTree.fromstring(files["modelDescription.xml"]).iterfind(
            "CoSimulation/SourceFiles/File"
        )
    return tuple(item.get("name", "") for item in found)
