"""``lumbar new-study``: a commented study for a folder of lifting recordings, to be completed by a person."""

import json
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import as_name, write_text
from lumbar.base.templates import template
from lumbar.interface.lift import marker_files
from lumbar.interface.marker_set import (
    NEEDED,
    NOTES,
    REASONS,
    MarkerSet,
    alias_text,
    joined_aliases,
    marker_set,
)
from lumbar.lifting.movement.carried_object import WRISTS, lift_windows
from lumbar.lifting.quality.body import stature_found
from lumbar.lifting.quality.landmarks import landmarks
from lumbar.records.ground_forces import names_forces
from lumbar.records.marker_aliases import resolve_aliases
from lumbar.records.marker_axes import rotation_to_standard
from lumbar.records.marker_file import NoMarkers
from lumbar.records.markers import METRES, MarkerRecording, read_markers
from lumbar.records.unpacking import stem_of
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import EventSettings
from lumbar.settings.plain import from_plain, plain
from lumbar.settings.stability import GridSettings
from lumbar.study.validation import FILL_IN

STILL_M = 0.1
"""A recording in which nine of ten markers stay within a cube of this size is a static trial: a person who stands sways."""
_STATURES_M = (1.2, 2.3)
FORCE_FILES = (".mot", ".sto", ".forces", ".anc")
_KIND_OF_FILE = re.compile("grfs?|forces?|ground|reactions?|markers?|mocap")
"""Words in the name of a file that say what it holds and not of which trial."""
SCHEMA = "# yaml-language-server: $schema=../../workflow/lumbar/study/study.schema.json"
NOTHING = MarkerSet({}, None)


@dataclass(frozen=True)
class FoundRecording:
    """One marker file of the folder."""

    path: str
    """Below the folder."""
    person: str
    problem: str = ""
    """Why it cannot be read; empty where it can."""
    seconds: float = 0.0
    rate: float = 0.0
    labels: frozenset[str] = frozenset()
    """Of its markers, without subject prefixes."""
    static: bool = False
    """Whether nothing moves throughout."""
    events: str = ""
    """Events that the file itself holds."""
    forces: str = ""
    """File of ground reaction forces with the same name, below the folder; empty without one."""
    unit: str = ""
    """Of length, by the body's size; empty where the file states it."""
    windows: tuple[tuple[float, float], ...] = ()
    """Parts that may each be a lift, in seconds; none where it may be one at most."""
    set: MarkerSet = NOTHING

    @property
    def facts(self) -> str:
        """Rate, length, markers and events for a comment."""
        words = f"{self.rate:g} Hz, {self.seconds:.1f} s, {len(self.labels)} markers"
        return f"{words}; {self.events}" if self.events else words


@dataclass(frozen=True, repr=False)
class NewStudy:
    """What is known of a folder of recordings, as files that a person completes."""

    name: str
    files: dict[str, str]
    """Text of every file by its path in the project."""
    recordings: list[FoundRecording]

    def save(self, project: str | os.PathLike = ".") -> list[Path]:
        """Write the files into a project; return their paths.

        Raises
        ------
        InputError
            If one of them is there: what a person filled in is not written over.
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
    """Look at the marker files of a folder and write down what is to be known of them.

    Parameters
    ----------
    folder : path
        Marker files of one person, or a folder below it per person.
    name : str, optional
        Of the study; default the folder's.

    Raises
    ------
    InputError
        If no marker file can be read, or the files stand along several axes: each such group is a study of its own.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    name = as_name(name or folder.resolve().name, "study")
    found = [_looked_at(path, folder, name) for path in marker_files(folder, tables=True)]
    recordings = [item for item in found if item is not None]
    read = [item for item in recordings if not item.problem]
    if not read:
        raise InputError(
            "\n".join(
                [f"{folder}: no marker file can be read", *(f"  - {item.problem}" for item in recordings)]
            )
        )
    axes, unit = _axes(read, folder), _unit(read, folder)
    people = {
        person: [item for item in recordings if item.person == person]
        for person in sorted({item.person for item in read})
    }
    files = {f"config/studies/{name}.yaml": _study_text(name, folder, axes, unit, people)}
    for person, items in people.items():
        files[f"config/subjects/{person}.yaml"] = _subject_text(name, person, items, axes[1])
    return NewStudy(name, files, recordings)


def _looked_at(path: Path, folder: Path, study: str) -> FoundRecording | None:
    """What is in one file; None for a table without markers."""
    below = path.relative_to(folder)
    person = study if len(below.parts) == 1 else f"{study}_{as_name(below.parts[0], 'study')}"
    try:
        recording, unit = _read(path)
        found = marker_set(recording)
    except NoMarkers:
        return None
    except LumbarError as error:
        return FoundRecording(str(below), person, str(error).splitlines()[0])
    times = sorted({f"{event.label} at {event.time:.2f} s" for event in recording.events})
    return FoundRecording(
        path=str(below),
        person=person,
        seconds=len(recording) / recording.rate,
        rate=recording.rate,
        labels=frozenset(label.rpartition(":")[2] for label in recording.positions),
        static=_stands_still(recording),
        events=f"events in the file: {', '.join(times)}" if times else "",
        forces=_forces_beside(path, folder),
        unit=unit,
        windows=_windows(recording, found),
        set=found,
    )


def _windows(recording: MarkerRecording, found: MarkerSet) -> tuple[tuple[float, float], ...]:
    """Parts of a recording in which the box, or the hands, rise each time; none where they do so once."""
    if found.axes is None:
        return ()
    rotation = rotation_to_standard(*found.axes[:2])
    points = {label.rpartition(":")[2]: values @ rotation.T for label, values in recording.positions.items()}
    carried = {
        name: term for name, term in found.aliases.items() if name.startswith("BOX_") or name in WRISTS
    }
    resolved = resolve_aliases(carried, points, {}, {}, recording.source, [])
    parts = lift_windows(replace(recording, positions=resolved.positions), EventSettings())
    return tuple(parts) if len(parts) > 1 else ()


def _read(path: Path) -> tuple[MarkerRecording, str]:
    """A recording in its own axes, which are not known yet, and the unit of length that it does not state itself."""
    layout = MarkerLayout(check_axes=False, subject_prefix="keep")
    try:
        return read_markers(path, layout, minimum_frames=1), ""
    except NoMarkers:
        raise
    except InputError as stated:
        for unit in METRES:
            try:
                recording = read_markers(path, _in_unit(layout, unit), minimum_frames=1)
            except InputError:
                continue
            if _is_a_persons_size(recording):
                return recording, unit
        raise stated


def _in_unit(layout: MarkerLayout, unit: str) -> MarkerLayout:
    return from_plain(type(layout), {**plain(layout), "unit": unit})


def _is_a_persons_size(recording: MarkerRecording) -> bool:
    named = {label: landmark for landmark, label in landmarks(recording.positions).items()}
    stature, lengths = stature_found(recording.positions, named)
    return lengths > 1 and _STATURES_M[0] < stature < _STATURES_M[1]


def _unit(read: Sequence[FoundRecording], folder: Path) -> str:
    """The unit that some files do not state; empty where all do. Those that do must state the same."""
    units = sorted({item.unit for item in read if item.unit})
    if not units:
        return ""
    layout = _in_unit(MarkerLayout(check_axes=False, subject_prefix="keep"), units[0])
    others = [item.path for item in read if item.unit not in ("", units[0])]
    for item in read:
        try:
            if not item.unit:
                read_markers(folder / item.path, layout, minimum_frames=1)
        except InputError:
            others.append(item.path)
    if others:
        raise InputError(
            f"{folder}: files that state no unit are in {units[0]} by the body's size, and others are not: {', '.join(others)}; "
            "make a study of each group"
        )
    return units[0]


def _forces_beside(path: Path, folder: Path) -> str:
    """The one ``.mot`` file with ground reaction forces whose name is that of a marker file, but for words such as ``grf``."""
    named = [
        file
        for file in sorted(path.parent.rglob("*"))
        if file.suffix.lower() == ".mot"
        and file.is_file()
        and _words(file) == _words(path)
        and names_forces(file)
    ]
    return str(named[0].relative_to(folder)) if len(named) == 1 else ""


def _words(path: Path) -> tuple[str, ...]:
    """Words of a file's name that tell the trial."""
    words = re.split(r"[^a-z0-9]+", stem_of(path).lower())
    return tuple(word for word in words if word and not _KIND_OF_FILE.fullmatch(word))


def _stands_still(recording: MarkerRecording) -> bool:
    ranges = [
        np.ptp(points[np.isfinite(points).all(axis=1)], axis=0).max()
        for points in recording.positions.values()
    ]
    return bool(np.quantile(ranges, 0.9) < STILL_M)


def _axes(read: Sequence[FoundRecording], folder: Path) -> tuple[str, str, float]:
    """Axes of all files, as the body tells them: how most face; a trial that faces another way says so itself."""
    # A static trial gives shapes, whichever way the person faces; alone it is the study.
    moving = [item for item in read if not item.static and item.set.axes] or read
    told = [(*item.set.axes, item.path) for item in moving if item.set.axes is not None]
    if not told:
        return FILL_IN, FILL_IN, 0.0
    ups = {up for up, *_ in told}
    if len(ups) > 1:
        lines = [
            f"  - up {one}: {', '.join(path for up, *_, path in told if up == one)}" for one in sorted(ups)
        ]
        raise InputError(
            "\n".join([f"{folder}: the bodies stand along several axes; make a study of each group", *lines])
        )
    forward = Counter(ahead for _, ahead, *_ in told).most_common(1)[0][0]
    return (
        ups.pop(),
        forward,
        float(np.median([degrees for _, ahead, degrees, _ in told if ahead == forward])),
    )


def _study_text(
    name: str,
    folder: Path,
    axes: tuple[str, str, float],
    unit: str,
    people: Mapping[str, Sequence[FoundRecording]],
) -> str:
    found = [item for group in people.values() for item in group]
    read = [item for item in found if not item.problem]
    named = {item.forces for item in read}
    forces = [path for path in folder.rglob("*") if path.suffix.lower() in FORCE_FILES]
    return _filled(
        "new_study.yaml.jinja",
        name=name,
        root=str(folder.resolve()),
        recordings=len(read),
        unread=[item for item in found if item.problem],
        forces=sorted({str(path.relative_to(folder)) for path in forces} - named),
        people=list(people),
        unit=unit,
        up=axes[0],
        forward=axes[1],
        degrees=axes[2],
        aliases=_alias_lines(
            joined_aliases([item.set for item in read]), all(item.set.joints for item in read)
        ),
        pivot=(pivot := _pivot_line(read)),
        control_weight=GridSettings().hip_control_weight if pivot.startswith("pivot") else None,
    )


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


_PIVOTS = {
    "mid_ankle": (("L_ANKLE", "R_ANKLE"),),
    "hip": (("L_HIP", "R_HIP"), ("L_ASIS", "R_ASIS", "SACRUM"), ("L_ASIS", "R_ASIS", "L_PSIS", "R_PSIS")),
    "L5": (("L5",),),
}
"""Pivots, the default first, each with the sets of landmarks of which one suffices."""


def _pivot_line(items: Sequence[FoundRecording]) -> str:
    """The first pivot that all moving recordings hold, where it is not the default; a still one has no pendulum."""
    moving = [item for item in items if not item.static] or items

    def holds(item: FoundRecording, pivot: str) -> bool:
        return any(set(needed) <= set(item.set.aliases) for needed in _PIVOTS[pivot])

    without = [item.path for item in moving if not holds(item, "mid_ankle")]
    if not without:
        return ""
    where = "" if len(without) == len(moving) else f" in {', '.join(without)}"
    pivot = next((name for name in _PIVOTS if all(holds(item, name) for item in moving)), None)
    if pivot is None:
        return (
            f"# pivot:  # no ankles are recognised{where}, and neither hips nor L5 in all files: "
            "without aliases for them there are no pendulums"
        )
    return f"pivot: {pivot}  # no markers on both ankles are recognised{where}"


def _static_of(read: Sequence[FoundRecording]) -> FoundRecording | None:
    """The first still recording that has most labels of another: what shares none is no trial of this marker set."""
    for item in read:
        others = [other for other in read if other is not item]
        if item.static and any(2 * len(item.labels & other.labels) > len(other.labels) for other in others):
            return item
    return None


def _subject_text(study: str, person: str, items: Sequence[FoundRecording], forward: str) -> str:
    read = [item for item in items if not item.problem]
    static = _static_of(read)
    trials = [item for item in read if item is not static]
    return _filled(
        "new_subject.yaml.jinja", study=study, person=person, static=static, trials=trials, forward=forward
    )


def _quoted(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z_./][\w./-]*", text) else json.dumps(text, ensure_ascii=False)
