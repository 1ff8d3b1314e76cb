"""``lumbar new-study``: recognised marker sets, and a commented template of study and subjects for a folder of recordings."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import sanitize_name, write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import shipped_yaml
from lumbar.interface.reading import MARKER_ENDINGS
from lumbar.lifting.quality.body import THIGH, landmarks
from lumbar.records.marker_aliases import resolve_aliases
from lumbar.records.marker_axes import find_axes
from lumbar.records.marker_file import NoMarkersError
from lumbar.records.markers import METRES, MarkerRecording, read_markers
from lumbar.records.unpacking import ending_of
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, OffsetPoint
from lumbar.settings.lifting import ALIASES
from lumbar.settings.validation import FILL_IN

if TYPE_CHECKING:
    from lumbar.records.markers import MarkerRecording


_BOX = re.compile(r"box|bo[iî]te|crate|kiste|caisse|load", re.IGNORECASE)
_TABLE = shipped_yaml(Path(__file__).with_name("marker_set.yaml"))


_ALIAS: TypeAdapter[Alias] = TypeAdapter(Alias)
RULES: dict[str, list[tuple[Alias, str]]] = {
    name: [(_ALIAS.validate_python(rule["is"]), rule.get("because", "")) for rule in rules]
    for name, rules in _TABLE["rules"].items()
}
"""Rules that fill a landmark, with the reason if a rule is a guess."""
REASONS = {(name, term): reason for name, rules in RULES.items() for term, reason in rules if reason}
NOTES = {(name, label): note for name, labels in _TABLE["notes"].items() for label, note in labels.items()}
NEEDED: dict[str, str] = _TABLE["needed"]


@dataclass(frozen=True)
class MarkerSet:
    """Markers recognised in one file."""

    aliases: dict[str, Alias]
    """Standard name to the label or rule that fills it."""
    axes: tuple[str, str] | None
    """Axes by `lumbar.records.marker_axes.find_axes`."""
    joints: bool = False
    """Whether the file holds joint centres, and no markers on the skin."""


def marker_set(recording: MarkerRecording) -> MarkerSet:
    """Recognise the markers of a file, read with its own labels, including subject prefixes, and in its own axes."""
    box = [_bare(label) for label in recording.positions if _BOX.search(label)]
    points = {_bare(label): values for label, values in recording.positions.items()}
    known = {name: label for name, label in landmarks(points).items() if label not in (*THIGH, *box)}
    aliases: dict[str, Alias] = {}
    for name in (*ALIASES, *known):
        if name in aliases or name.startswith("BOX_"):
            continue
        # Rules first, then the labels of the default aliases and of other marker sets, guesses last.
        rules, guesses = (
            [rule for rule, reason in RULES.get(name, ()) if bool(reason) == guess] for guess in (False, True)
        )
        terms = [
            *rules,
            *_alternatives(ALIASES.get(name)),
            *([known[name]] if name in known else []),
            *guesses,
        ]
        term = next((term for term in terms if _fills(term, points, aliases)), None)
        if term is not None:
            aliases[name] = term
    # Landmarks that others give, each after those it is derived from.
    for name in ("SACRUM", "C7", "T12", "L5"):
        term = next((rule for rule, _ in RULES[name] if _fills(rule, points, aliases)), None)
        if term is not None:
            aliases.setdefault(name, term)
    aliases |= {f"BOX_{number}": label for number, label in enumerate(box, start=1)}
    # Labels that are landmarks but no standard names stay labels.
    aliases = {name: term for name, term in aliases.items() if name in ALIASES or name.startswith("BOX_")}
    found = resolve_aliases(aliases, points, {}, {}, recording.source, [])
    return MarkerSet(aliases, find_axes(found.positions), recording.joints)


def _bare(label: str) -> str:
    return label.rpartition(":")[2]


def _alternatives(alias: Alias | None) -> tuple:
    if alias is None:
        return ()
    return alias if isinstance(alias, tuple) else (alias,)


def _fills(term: Alias, points: Iterable[str], aliases: dict[str, Alias]) -> bool:
    """Return whether every marker that a term needs is there."""
    if isinstance(term, str):
        return term in points or term in aliases
    if isinstance(term, tuple):
        return any(_fills(part, points, aliases) for part in term)
    if isinstance(term, OffsetPoint):
        return _fills(term.start, points, aliases)
    parts = term.mean if isinstance(term, MeanOfMarkers) else term.between
    return all(_fills(part, points, aliases) for part in parts)


def _rank(name: str, term: Alias) -> tuple[int, int]:
    """Return the order of a landmark's terms: a rule or label of the table, another label, a guess."""
    rules = [rule for rule, _ in RULES.get(name, ())]
    usual = _alternatives(ALIASES.get(name))
    if (name, term) in REASONS:
        return 3, rules.index(term)
    if term in rules:
        return 0, rules.index(term)
    return (1, usual.index(term)) if term in usual else (2, 0)


def alias_text(term: Alias | tuple[Alias, ...]) -> str:
    """Return an alias in YAML on one line.

    Examples
    --------
    >>> alias_text(("SACR", MeanOfMarkers(mean=("LPSI", "RPSI"))))
    '[SACR, {mean: [LPSI, RPSI]}]'
    """
    if isinstance(term, str):
        # Words such as NO and ON are not text in YAML.
        plain = re.fullmatch(r"[A-Za-z_]\w+", term) and term.lower() not in ("no", "on", "off", "yes", "null")
        return term if plain else json.dumps(term, ensure_ascii=False)
    if isinstance(term, tuple):
        return f"[{', '.join(map(alias_text, term))}]"
    if isinstance(term, MeanOfMarkers):
        return f"{{mean: [{', '.join(map(alias_text, term.mean))}]}}"
    if isinstance(term, OffsetPoint):
        return f"{{from: {alias_text(term.start)}, offset_m: {list(term.offset_m)}}}"
    return f"{{between: [{', '.join(map(alias_text, term.between))}], share: {term.share:g}}}"


SCHEMA = "# yaml-language-server: $schema=../../workflow/lumbar/study/study.schema.json"
TABLES = (".csv", ".tsv")
NOTHING = MarkerSet({}, None)


@dataclass(frozen=True)
class FolderRecording:
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
    recordings: list[FolderRecording]

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
    """Write templates of a study and its subjects, with the labels recognised in the marker files of a folder.

    Parameters
    ----------
    folder : path
        Marker files of one subject, or a folder below it per subject.
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
    name = sanitize_name(name or folder.resolve().name, "study")
    endings = (*MARKER_ENDINGS, *TABLES)
    paths = sorted(path for path in folder.rglob("*") if ending_of(path) in endings and path.is_file())
    if not paths:
        raise InputError(f"{folder}: no marker file ({', '.join(endings)}) in this folder")
    recordings = [item for item in (_look_at(path, folder, name) for path in paths) if item is not None]
    read = [item for item in recordings if not item.problem]
    if not read:
        problems = [f"  - {item.problem}" for item in recordings]
        raise InputError("\n".join([f"{folder}: no marker file can be read", *problems]))
    people: dict[str, list[FolderRecording]] = {}
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
        aliases=_alias_lines([item.set for item in read]),
    )
    files = {f"config/studies/{name}.yaml": study}
    for person, items in people.items():
        files[f"config/subjects/{person}.yaml"] = _filled(
            "new_subject.yaml.jinja", study=name, person=person, trials=items, forward=forward
        )
    return NewStudy(name, files, recordings)


def _look_at(path: Path, folder: Path, study: str) -> FolderRecording | None:
    """Read one file; None for a table without markers."""
    below = path.relative_to(folder)
    person = study if len(below.parts) == 1 else f"{study}_{sanitize_name(below.parts[0], 'study')}"
    try:
        recording, states_unit = _read(path)
    except NoMarkersError:
        return None
    except LumbarError as error:
        return FolderRecording(str(below), person, str(error).splitlines()[0])
    seconds, count = len(recording) / recording.rate, len(recording.positions)
    facts = f"{recording.rate:g} Hz, {seconds:.1f} s, {count} markers"
    return FolderRecording(str(below), person, "", facts, states_unit, marker_set(recording))


def _read(path: Path) -> tuple[MarkerRecording, bool]:
    """Return a recording with its own labels and axes, and whether the file states the unit of length.

    If it does not, any unit serves to recognise labels and axes.
    """
    layout = {"check_axes": False, "subject_prefix": "keep"}
    try:
        return read_markers(path, MarkerLayout(**layout), minimum_frames=1), True
    except NoMarkersError:
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


def _alias_lines(sets: Sequence[MarkerSet]) -> list[str]:
    """Return the aliases of several files: every term that one of them needs, the best first."""
    joined: dict[str, dict[Alias, None]] = {}
    for item in sets:
        for name, term in item.aliases.items():
            joined.setdefault(name, {})[term] = None
    aliases = {name: tuple(sorted(terms, key=partial(_rank, name))) for name, terms in joined.items()}
    joints, lines = all(item.joints for item in sets), []
    for name, terms in aliases.items():
        text = alias_text(terms if len(terms) > 1 else terms[0])
        reasons = [REASONS[name, term] for term in terms if (name, term) in REASONS]
        condition = "not measured" if len(reasons) == len(terms) else "if not measured"
        comments = [f"{condition}: {'; '.join(reasons)}"] if reasons else []
        comments += [f"{term} is {NOTES[name, term]}" for term in terms if (name, term) in NOTES]
        lines.append(f"{name}: {text}" + (f"  # {'; '.join(comments)}" if comments else ""))
    for name, purpose in NEEDED.items():
        if name not in aliases and not (joints and purpose == NEEDED["SACRUM"]):
            lines.append(f"# {name}:  # not recognised; {purpose}")
    if not any(name.startswith("BOX_") for name in aliases):
        lines.append("# BOX_1:  # no markers on the box recognised: the hands replace it")
    return lines


def _quoted(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z_./][\w./-]*", text) else json.dumps(text, ensure_ascii=False)
