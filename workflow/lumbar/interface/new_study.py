"""``lumbar new-study``: a commented template of study and subjects for a folder of lifting recordings."""

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import as_name, write_text
from lumbar.base.templates import template
from lumbar.interface.marker_set import (
    NEEDED,
    NOTES,
    REASONS,
    MarkerSet,
    alias_text,
    joined_aliases,
    marker_set,
)
from lumbar.interface.reading import MARKER_ENDINGS
from lumbar.records.marker_file import NoMarkers
from lumbar.records.markers import METRES, MarkerRecording, read_markers
from lumbar.records.unpacking import ending_of
from lumbar.settings.layout import MarkerLayout
from lumbar.study.validation import FILL_IN

SCHEMA = "# yaml-language-server: $schema=../../workflow/lumbar/study/study.schema.json"
TABLES = (".csv", ".tsv")
NOTHING = MarkerSet({}, None)


@dataclass(frozen=True)
class FoundRecording:
    """One marker file of the folder."""

    path: str
    """Path relative to the folder."""
    person: str
    problem: str = ""
    """Reason why the file cannot be read; empty if it can."""
    facts: str = ""
    """Rate, length and number of markers, for a comment."""
    states_unit: bool = True
    set: MarkerSet = NOTHING


@dataclass(frozen=True, repr=False)
class NewStudy:
    """Templates of a study and its subjects, which the user completes."""

    name: str
    files: dict[str, str]
    """Text of every file by its path in the project."""
    recordings: list[FoundRecording]

    def save(self, project: str | os.PathLike = ".") -> list[Path]:
        """Write the files into a project; return their paths.

        Raises
        ------
        InputError
            If one of them exists: it is not overwritten.
        """
        paths = [Path(project) / name for name in self.files]
        there = [str(path) for path in paths if path.exists()]
        if there:
            raise InputError(f"{', '.join(there)}: already there, and not written over; take another --name")
        for path, text in zip(paths, self.files.values(), strict=True):
            write_text(path, text)
        return paths

    def __repr__(self) -> str:
        read = [item for item in self.recordings if not item.problem]
        lines = [f"{len(read)} of {len(self.recordings)} recordings can be read"]
        lines += [f"  {item.path}: {item.problem or item.facts}" for item in self.recordings]
        lines += [f"{path}: {text.count(FILL_IN) - 1} values to fill in" for path, text in self.files.items()]
        study, *people = self.files
        lines.append(
            f"replace every {FILL_IN}, then, one lift: lumbar lift FILE --config {study} --subject {people[0]} --output out"
        )
        lines.append(
            f"or all, in the project's folder: snakemake --cores 2 lifting stability --configfile {study}"
        )
        return "\n".join(lines)


def new_study(folder: str | os.PathLike, name: str | None = None) -> NewStudy:
    """Write templates of a study and its subjects, with the labels that are recognised in the marker files of a folder.

    Parameters
    ----------
    folder : path
        Marker files of one person, or a folder below it per person.
    name : str, optional
        Name of the study; default the folder's.

    Raises
    ------
    InputError
        If no marker file can be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    name = as_name(name or folder.resolve().name, "study")
    found = [_look_at(path, folder, name) for path in _marker_files(folder)]
    recordings = [item for item in found if item is not None]
    read = [item for item in recordings if not item.problem]
    if not read:
        problems = [f"  - {item.problem}" for item in recordings]
        raise InputError("\n".join([f"{folder}: no marker file can be read", *problems]))
    people: dict[str, list[FoundRecording]] = {}
    for item in sorted(read, key=lambda one: one.person):
        people.setdefault(item.person, []).append(item)
    up, forward = next((item.set.axes for item in read if item.set.axes), (FILL_IN, FILL_IN))
    study = _filled(
        "new_study.yaml.jinja",
        name=name,
        root=str(folder.resolve()),
        recordings=len(read),
        unread=[item for item in recordings if item.problem],
        people=list(people),
        states_unit=all(item.states_unit for item in read),
        up=up,
        forward=forward,
        has_ankles=all({"L_ANKLE", "R_ANKLE"} <= item.set.aliases.keys() for item in read),
        aliases=_alias_lines(
            joined_aliases([item.set for item in read]), all(item.set.joints for item in read)
        ),
    )
    files = {f"config/studies/{name}.yaml": study}
    for person, items in people.items():
        files[f"config/subjects/{person}.yaml"] = _filled(
            "new_subject.yaml.jinja", study=name, person=person, trials=items, forward=forward
        )
    return NewStudy(name, files, recordings)


def _marker_files(folder: Path) -> Sequence[Path]:
    """Marker files in a folder and the folders below it, in order of their paths."""
    endings = (*MARKER_ENDINGS, *TABLES)
    files = sorted(path for path in folder.rglob("*") if ending_of(path) in endings and path.is_file())
    if not files:
        raise InputError(f"{folder}: no marker file ({', '.join(endings)}) in this folder")
    return files


def _look_at(path: Path, folder: Path, study: str) -> FoundRecording | None:
    """Read one file; None for a table without markers."""
    below = path.relative_to(folder)
    person = study if len(below.parts) == 1 else f"{study}_{as_name(below.parts[0], 'study')}"
    try:
        recording, states_unit = _read(path)
    except NoMarkers:
        return None
    except LumbarError as error:
        return FoundRecording(str(below), person, str(error).splitlines()[0])
    seconds, count = len(recording) / recording.rate, len(recording.positions)
    facts = f"{recording.rate:g} Hz, {seconds:.1f} s, {count} markers"
    return FoundRecording(str(below), person, "", facts, states_unit, marker_set(recording))


def _read(path: Path) -> tuple[MarkerRecording, bool]:
    """Return a recording with its own labels and axes, and whether the file states the unit of length.

    If it does not, any unit serves to recognise labels and axes.
    """
    layout = {"check_axes": False, "subject_prefix": "keep"}
    try:
        return read_markers(path, MarkerLayout(**layout), minimum_frames=1), True
    except NoMarkers:
        raise
    except InputError as stated:
        for unit in METRES:
            try:
                assumed = MarkerLayout(**layout, unit=unit)
                return read_markers(path, assumed, minimum_frames=1), False
            except InputError:
                continue
        raise stated


def _filled(file: str, **values) -> str:
    return template(f"interface/{file}").render(schema=SCHEMA, fill_in=FILL_IN, quoted=_quoted, **values)


def _alias_lines(aliases: Mapping[str, tuple], joints: bool) -> list[str]:
    lines = []
    for name, terms in aliases.items():
        text = alias_text(terms if len(terms) > 1 else terms[0])
        reasons = [REASONS[name, term] for term in terms if (name, term) in REASONS]
        where = "not measured" if len(reasons) == len(terms) else "where not measured"
        told = [f"{where}: {'; '.join(reasons)}"] if reasons else []
        told += [f"{term} is {NOTES[name, term]}" for term in terms if (name, term) in NOTES]
        lines.append(f"{name}: {text}" + (f"  # {'; '.join(told)}" if told else ""))
    for name, purpose in NEEDED.items():
        if name not in aliases and not (joints and purpose == NEEDED["SACRUM"]):
            lines.append(f"# {name}:  # not recognised; {purpose}")
    if not any(name.startswith("BOX_") for name in aliases):
        lines.append("# BOX_1:  # no markers on the box recognised: the hands stand for it")
    return lines


def _quoted(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z_./][\w./-]*", text) else json.dumps(text, ensure_ascii=False)
