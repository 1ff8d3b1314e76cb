"""``lumbar new-study``: recognised marker sets, and a commented template of study and subjects for a folder of recordings."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from lumbar.base.errors import InputError, LumbarError
from lumbar.base.files import sanitize_name, write_text
from lumbar.base.templates import template
from lumbar.base.yaml_file import shipped_yaml
from lumbar.interface.reading import MARKER_ENDINGS
from lumbar.lifting.quality.gate import mask_findings
from lumbar.lifting.quality.marker_sets import recognise
from lumbar.lifting.quality.screening import Screening
from lumbar.records.marker_aliases import KEEP, labels_of, resolve_aliases
from lumbar.records.marker_axes import BodyAxes, find_axes
from lumbar.records.marker_file import NoMarkersError
from lumbar.records.markers import METRES, MarkerRecording, read_markers
from lumbar.records.unpacking import ending_of
from lumbar.settings.layout import Alias, MarkerLayout, MeanOfMarkers, PointBetween
from lumbar.settings.lifting import ALIASES, LiftingSettings
from lumbar.settings.validation import FILL_IN

_BOX = re.compile(r"box|bo[iî]te|crate|kiste|caisse|load", re.IGNORECASE)
_TABLE = shipped_yaml(Path(__file__).with_name("marker_set.yaml"))


_ALIAS_ADAPTER: TypeAdapter[Alias] = TypeAdapter(Alias)
_RULES: dict[str, list[tuple[Alias, str]]] = {
    name: [(_ALIAS_ADAPTER.validate_python(rule["is"]), rule.get("because", "")) for rule in rules]
    for name, rules in _TABLE["rules"].items()
}
"""Rules that give the position of each landmark, with the reason if a rule is a guess."""
_REASONS = {(name, term): reason for name, rules in _RULES.items() for term, reason in rules if reason}
_NOTES = {(name, label): note for name, labels in _TABLE["notes"].items() for label, note in labels.items()}
_PURPOSES: dict[str, str] = _TABLE["needed"]


@dataclass(frozen=True)
class MarkerSet:
    """Set of markers that was recognised in one file."""

    aliases: dict[str, Alias]
    """Label or rule by standard name."""
    axes: BodyAxes | None
    """Axes of the file; None if the labels do not show them."""
    joints: bool = False
    """True if the file has joint centres instead of markers on the skin."""
    unused: tuple[str, ...] = ()
    """Labels that no alias names."""


def marker_set(recording: MarkerRecording) -> MarkerSet:
    """Recognise the markers of a file.

    Parameters
    ----------
    recording : MarkerRecording
        Markers with the labels (also subject prefixes) and the axes of the file.
    """
    points = {label.rpartition(":")[2]: values for label, values in recording.positions.items()}
    box = [label.rpartition(":")[2] for label in recording.positions if _BOX.search(label)]
    kind, found = recognise(label for label in points if label not in box)
    aliases: dict[str, Alias] = {
        name: MeanOfMarkers(mean=labels) if len(labels) > 1 else labels[0] for name, labels in found.items()
    }
    # Each landmark after those from which it is derived.
    for name, rules in _RULES.items():
        term = next((rule for rule, _ in rules if _is_available(rule, points.keys() | aliases)), None)
        if name not in aliases and term is not None:
            aliases[name] = term
    used = {label for name in _RULES for label in labels_of(name, aliases)}
    aliases = {name: term for name, term in aliases.items() if name in ALIASES or name in used - {term}}
    aliases |= {f"BOX_{number}": label for number, label in enumerate(box, start=1)}
    # Only measured markers show the axes, as in `lumbar inspect`.
    measured = {name: points[labels[0]] for name, labels in found.items()}
    unused = resolve_aliases(aliases, points, {}, {}, recording.source, []).unused
    return MarkerSet(aliases, find_axes(measured), recording.joints or kind.joints, unused)


def recognise_settings(
    path: Path, height_m: float | None = None, needs_axes: bool = False
) -> LiftingSettings:
    """Return settings with the labels and the axes that are recognised in a marker file.

    Parameters
    ----------
    path : Path
        C3D, TRC, CSV or BVH file.
    height_m : float, optional
        Stature of the subject, for the check of body lengths.
    needs_axes : bool, default False
        True refuses a file whose labels do not show the axes; False assumes the default axes.

    Raises
    ------
    InputError
        If the axes are needed and not known.
    """
    # With prefixes, because these may name a box.
    layout = MarkerLayout(subject_prefix=KEEP, required=(), check_axes=False)
    screening = Screening(height_m, {}, refuse=False)
    recording = read_markers(path, layout, screen=screening)
    masked = mask_findings(screening.points, screening.findings)
    usable = {label: places for label, places in masked.items() if np.isfinite(places).any()}
    recognised = marker_set(replace(recording, positions=usable))
    layout = MarkerLayout(aliases=recognised.aliases, required=())
    if recognised.joints:
        layout = layout.model_copy(update={"points": "joint_centres"})
    if needs_axes and not (recognised.axes and recognised.axes.forward):
        raise InputError(
            f"{path}: the labels do not show which way the subject faces; write a study with 'lumbar new-study FOLDER', set "
            "markers.up and markers.forward in it, and give it with --config"
        )
    if recognised.axes:
        forward = recognised.axes.forward or layout.forward
        if forward[1] != recognised.axes.up[1]:
            layout = layout.model_copy(update={"up": recognised.axes.up, "forward": forward})
    return LiftingSettings(markers=layout)


def _is_available(term: Alias, known: Collection[str]) -> bool:
    """Return whether every marker of a rule is known."""
    if isinstance(term, MeanOfMarkers | PointBetween):
        parts = term.mean if isinstance(term, MeanOfMarkers) else term.between
        return all(_is_available(part, known) for part in parts)
    return term in known


def format_yaml(value: Alias | tuple[Alias, ...]) -> str:
    """Return a text, an alias or several aliases in YAML on one line.

    Parameters
    ----------
    value : str, Alias or tuple of Alias
        Value of a key of a study's markers.

    Examples
    --------
    >>> format_yaml(("SACR", MeanOfMarkers(mean=("LPSI", "RPSI"))))
    '[SACR, {mean: [LPSI, RPSI]}]'
    """
    import yaml

    plain: Any = TypeAdapter(Any).dump_python(value, mode="json", by_alias=True)
    style = {"default_flow_style": True, "allow_unicode": True, "sort_keys": False, "width": 1000}
    return yaml.safe_dump([plain], **style).strip()[1:-1]  # quoted as inside a list


_SCHEMA = "# yaml-language-server: $schema=../../workflow/lumbar/study/study.schema.json"


@dataclass(frozen=True)
class FolderRecording:
    """One marker file of the folder."""

    path: str
    """Path relative to the folder."""
    person: str
    problem: str = ""
    """Reason why the file cannot be read; empty if the file can be read."""
    facts: str = ""
    """Rate, length and number of markers, for a comment."""
    states_unit: bool = True
    set: MarkerSet = MarkerSet({}, None)


@dataclass(frozen=True, repr=False)
class NewStudy:
    """Templates of a study and its subjects, which the user completes."""

    name: str
    files: dict[str, str]
    """Text of every file by its path in the project."""
    recordings: list[FolderRecording]

    def save(self, project: str | os.PathLike = ".") -> list[Path]:
        """Write the files into a project; return their paths.

        Parameters
        ----------
        project : path
            Folder of the project.

        Raises
        ------
        InputError
            If one of the files exists; it is not overwritten.
        """
        paths = [Path(project) / name for name in self.files]
        there = [str(path) for path in paths if path.exists()]
        if there:
            raise InputError(f"{', '.join(there)}: exists and is not overwritten; use another --name")
        for path, text in zip(paths, self.files.values(), strict=True):
            write_text(path, text)
        return paths

    def __repr__(self) -> str:
        valid = [item for item in self.recordings if not item.problem]
        study, *people = self.files
        command = f"lumbar lift FILE --config {study} --subject {people[0]} --output out"
        return "\n".join(
            [
                f"{len(valid)} of {len(self.recordings)} recordings can be read",
                *(f"  {item.path}: {item.problem or item.facts}" for item in self.recordings),
                *(
                    f"{path}: {text.count(FILL_IN) - 1} values to fill in"
                    for path, text in self.files.items()
                ),
                f"replace every {FILL_IN}, then, one lift: {command}",
                f"or all, in the project's folder: snakemake --cores 2 lifting stability --configfile {study}",
            ]
        )


def new_study(folder: str | os.PathLike, name: str | None = None) -> NewStudy:
    """Write templates of a study and its subjects, with the labels recognised in the marker files of a folder.

    Parameters
    ----------
    folder : path
        Folder with marker files of one subject, or with one folder per subject.
    name : str, optional
        Name of the study; default the folder's.

    Raises
    ------
    InputError
        If no marker file can be read.

    Examples
    --------
    >>> import lumbar
    >>> from pathlib import Path
    >>> from lumbar.twin.examples import example_lift
    >>> Path("my_lab").mkdir()
    >>> subject = example_lift(Path("my_lab/lift.c3d"))
    >>> list(lumbar.new_study("my_lab").files)
    ['config/studies/my_lab.yaml', 'config/subjects/my_lab.yaml']
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    name = sanitize_name(name or folder.resolve().name, "study")
    endings = (*MARKER_ENDINGS, ".csv", ".tsv")
    paths = sorted(path for path in folder.rglob("*") if ending_of(path) in endings and path.is_file())
    if not paths:
        raise InputError(f"{folder}: no marker file ({', '.join(endings)}) in this folder")
    recordings = [item for item in (_read(path, folder, name) for path in paths) if item is not None]
    valid = [item for item in recordings if not item.problem]
    if not valid:
        problems = [f"  - {item.problem}" for item in recordings]
        raise InputError("\n".join([f"{folder}: no marker file can be read", *problems]))
    people: dict[str, list[FolderRecording]] = {}
    for item in sorted(valid, key=lambda one: one.person):
        people.setdefault(item.person, []).append(item)
    axes = [item.set.axes for item in valid if item.set.axes]
    forward = next((item.forward for item in axes if item.forward), FILL_IN)
    study = _render(
        "new_study.yaml.jinja",
        name=name,
        root=str(folder.resolve()),
        recordings=len(valid),
        unread=[item for item in recordings if item.problem],
        people=list(people),
        states_unit=all(item.states_unit for item in valid),
        joints=all(item.set.joints for item in valid),
        up=axes[0].up if axes else FILL_IN,
        forward=forward,
        evidence=next(iter(axes), ""),
        has_ankles=all({"L_ANKLE", "R_ANKLE"} <= item.set.aliases.keys() for item in valid),
        aliases=_alias_lines([item.set for item in valid]),
        unused=dict.fromkeys(" ".join(label.split()) for item in valid for label in item.set.unused),
    )
    files = {f"config/studies/{name}.yaml": study}
    for person, items in people.items():
        files[f"config/subjects/{person}.yaml"] = _render(
            "new_subject.yaml.jinja", study=name, person=person, trials=items, forward=forward
        )
    return NewStudy(name, files, recordings)


def _read(path: Path, folder: Path, study: str) -> FolderRecording | None:
    """Read one file with its own labels and axes; None for a table without markers.

    If the file does not state the unit of length, any unit is assumed: labels and axes do not depend on it.
    """
    relative = path.relative_to(folder)
    has_folder = len(relative.parts) > 1
    person = f"{study}_{sanitize_name(relative.parts[0], 'study')}" if has_folder else study
    layout = {"check_axes": False, "subject_prefix": "keep"}
    problem = ""
    for unit in ({}, *({"unit": unit} for unit in METRES)):
        try:
            recording = read_markers(path, MarkerLayout(**layout, **unit), minimum_frames=1)
        except NoMarkersError:
            return None
        except LumbarError as error:
            problem = problem or str(error).splitlines()[0]
            continue
        seconds, count = len(recording) / recording.rate, len(recording.positions)
        facts = f"{recording.rate:g} Hz, {seconds:.1f} s, {count} markers"
        return FolderRecording(str(relative), person, "", facts, not unit, marker_set(recording))
    return FolderRecording(str(relative), person, problem)


def _render(file: str, **values) -> str:
    return template(f"interface/{file}").render(schema=_SCHEMA, fill_in=FILL_IN, quoted=format_yaml, **values)


def _alias_lines(sets: Sequence[MarkerSet]) -> list[str]:
    """Return the aliases of several files: for each name all terms that a file needs, the best first."""
    joined: dict[str, dict[Alias, None]] = {}
    for item in sets:
        for name, term in item.aliases.items():
            joined.setdefault(name, {})[term] = None
    aliases = {
        name: tuple(sorted(terms, key=lambda term: (name, term) in _REASONS))
        for name, terms in joined.items()
    }
    joints, lines = all(item.joints for item in sets), []
    for name, terms in aliases.items():
        text = format_yaml(terms if len(terms) > 1 else terms[0])
        reasons = [_REASONS[name, term] for term in terms if (name, term) in _REASONS]
        condition = "not measured" if len(reasons) == len(terms) else "if not measured"
        comments = [f"{condition}: {'; '.join(reasons)}"] if reasons else []
        comments += [f"{term} is {_NOTES[name, term]}" for term in terms if (name, term) in _NOTES]
        lines.append(f"{name}: {text}" + (f"  # {'; '.join(comments)}" if comments else ""))
    for name, purpose in _PURPOSES.items():
        if name not in aliases and not (joints and purpose == _PURPOSES["SACRUM"]):
            lines.append(f"# {name}:  # not recognised; {purpose}")
    if not any(name.startswith("BOX_") for name in aliases):
        has_hands = not {"L_WRIST", "R_WRIST"}.isdisjoint(aliases)
        instead = "the hands replace it" if has_hands else "the events need it, or L_WRIST and R_WRIST"
        lines.append(f"# BOX_1:  # no markers on the box recognised: {instead}")
    return lines
