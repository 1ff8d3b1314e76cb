"""``lumbar.lift``: from the markers of a trial to the pendulums of the deposit."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.interface.new_study import recognise_settings
from lumbar.interface.result import Result, data_label
from lumbar.lifting.movement import events as event_rules
from lumbar.lifting.movement import lift_analysis as lifting
from lumbar.lifting.movement import lift_tables
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.lifting.quality.screening import QualitySheet, Screening, naming, quality_sheet, read_screened
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.lifting import LiftingSettings, SubjectSettings, TrialSettings

if TYPE_CHECKING:
    import pandas as pd


def lift(
    markers: MarkerRecording | str | os.PathLike,
    subject: SubjectSettings | str | os.PathLike,
    box_mass_kg: float | None = None,
    *,
    trial: TrialSettings | str | None = None,
    name: str | None = None,
    settings: LiftingSettings | None = None,
    static: str | os.PathLike | None = None,
    source_label: str = "",
) -> Lift:
    """Find the events, centres of mass and pendulum states of one lift.

    Parameters
    ----------
    markers : path or MarkerRecording
        C3D, TRC, CSV or BVH file, also packed (``.gz``). A recording from `lumbar.read`, changed or not, is analysed without
        checks of its quality.
    subject : SubjectSettings or path
        Settings of the subject, or a file as in ``config/subjects``.
    box_mass_kg : float, optional
        Mass of the box; default the mass in the trial.
    trial : TrialSettings or str, optional
        The trial, or the name of its lift, e.g. ``ann_15kg_2``; default the subject's trial with this marker file. A subject
        without trials needs none.
    name : str, optional
        Name of the lift; default the name of the trial, as in a study.
    settings : LiftingSettings, optional
        Markers, events, pivot and segments; default the usual ones, with the labels and axes that are recognised in the file.
    static : path, optional
        Marker file of a static trial; default the subject's static trial, relative to the folder of the trial's file.
    source_label : str
        Name of the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError, NumericalError
        If the lift cannot be analysed, with the file and the problem.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> subject = example_lift("lift.c3d")
    >>> print(lumbar.lift("lift.c3d", subject, box_mass_kg=15))
    lift_off: 2.310 s (box; 2.27 to 2.36)
    toe_off: 3.930 s (toes)
    deposit_start: 5.820 s (box; 5.78 to 6.06)
    release: 7.070 s (box)
    """
    if not isinstance(subject, SubjectSettings):
        from lumbar.study.load_study import load_subject

        subject = load_subject(Path(subject))
    given = None
    if isinstance(markers, MarkerRecording):
        given, markers = markers, markers.source or markers.name
    file = Path(markers)
    lift_name, trial = _find_trial(subject, file, box_mass_kg, trial)
    if settings is None:
        settings = (
            LiftingSettings()
            if given is not None
            else recognise_settings(file, subject.height_m, needs_axes=True)
        )
    name, settings = name or lift_name, settings.settings_for_trial(trial)
    static = static or (_find_static_file(subject, trial, file) if given is None else None)
    standing = None
    if static is not None:
        # A static trial is read by its own labels; it need not have all markers of a lift.
        bare = settings.markers.model_copy(update={"aliases": {}, "required": None, "check_axes": False})
        screening = Screening(subject.height_m, settings.markers.aliases)
        with naming(static):
            standing = read_markers(static, bare, minimum_frames=1, screen=screening).positions
    bodies = BodyFilling(settings, standing)
    if given is not None:
        recording = replace(given, name=name)
        sheet = quality_sheet(recording, recording.positions, ())
    else:
        recording, sheet = read_screened(file, settings.markers, name, subject.height_m, bodies)
        sheet = replace(sheet, findings=(*sheet.findings, *bodies.findings))
    analysed = lifting.analyse_lift(recording, subject, trial, settings, bodies.gaps, sheet.findings)
    return Lift(analysed, subject, trial, settings, data_label(source_label, [recording.source]), sheet)


@dataclass(frozen=True, eq=False, repr=False)
class Lift(Result):
    """One analysed lift."""

    analysed: lifting.AnalysedLift
    """Result of the pipeline: events, centres of mass, pendulum states."""
    subject: SubjectSettings
    trial: TrialSettings
    settings: LiftingSettings
    source_label: str
    quality: QualitySheet
    """Report on the recording, with the intervals that were left out as impossible for a body."""

    @property
    def name(self) -> str:
        """Name of the lift, e.g. ``"expert_23kg"``."""
        return self.analysed.recording.name

    @cached_property
    def states(self) -> pd.DataFrame:
        """Pendulum states of the deposit: one row per centre of mass, plane and instant."""
        return lift_tables.states_frame(self.analysed.states)

    @cached_property
    def _thesis_pendulums(self) -> lifting.ThesisPendulums | None:
        return lifting.thesis_pendulums(self.analysed, self.subject, self.trial, self.settings)

    @cached_property
    def thesis_states(self) -> pd.DataFrame:
        """Pendulum states by the thesis's pivot, segment ends and start of the deposit; empty if the study uses the same."""
        return lift_tables.states_frame(self._thesis_pendulums.states if self._thesis_pendulums else {})

    @cached_property
    def facts(self) -> dict:
        """Masses, lengths, pivots, rules and assumptions of the pendulums, and further facts for measures."""
        return {
            **lift_tables.summary(self.analysed, self.subject, self.trial, self.settings),
            "thesis_pendulum": self._thesis_pendulums and self._thesis_pendulums.facts,
            "height_m": self.subject.height_m,
            "no_deposit": lifting.no_deposit(self.analysed.events),
            "missing_points": self._body[1],
        }

    @cached_property
    def _body(self) -> tuple[pd.DataFrame, dict[str, str]]:
        return lift_tables.body_frame(self.analysed)

    @property
    def body(self) -> pd.DataFrame:
        """Trajectories of joints, feet, hands, load and centres of mass: ``lumbar.lifting.movement.lift_tables.body_frame``."""
        return self._body[0]

    @property
    def checks(self) -> list[str]:
        """Text lines on segment ends that are on the skin."""
        points, ends = self.analysed.points, self.analysed.table.ends
        return points.list_skin_rules(ends) if self.settings.segment_ends == "inner" else []

    @property
    def missing_pendulums(self) -> list[str]:
        """Indented text lines on centres of mass without a pendulum, with the remedy for missing markers."""
        reasons = [*self._describe_missing_pendulums(), lifting.recognised_unaliased(self.analysed.recording)]
        return [f"  {line}" for reason in reasons for line in reason.splitlines()]

    def _describe_missing_pendulums(self) -> list[str]:
        """Return one text line per reason with all centres of mass that have no pendulum for this reason."""
        coms: dict[str, list[str]] = {}
        for com, reason in self.analysed.missing.items():
            coms.setdefault(reason, []).append(com)
        return [f"no pendulum of {', '.join(names)}: {reason}" for reason, names in coms.items()]

    @property
    def _file_events(self) -> list[str]:
        """Text lines that compare the events stored in the file with the detected events."""
        labels = self.settings.events.labels
        return event_rules.compare_with_file(self.analysed.recording, self.analysed.events, labels)

    @property
    def events(self) -> dict[str, dict[str, Any]]:
        """Events by name, in the order in which they happen."""
        return {name: event.to_dict() for name, event in self.analysed.events.items()}

    @property
    def table(self) -> list[dict]:
        """Rows of the events, in the order in which they happen."""
        return list(self.events.values())

    def files(self) -> Iterator[tuple[str, Any]]:
        """Yield ``pendulum``, ``thesis_pendulum``, ``com``, ``body``, ``events``, ``gaps``, ``quality``, and data of figures."""
        label = {"data": self.source_label}
        tables = {
            "pendulum": self.states,
            "thesis_pendulum": self.thesis_states,
            "com": lift_tables.centres_frame(self.analysed),
            "body": self.body,
            "gaps": lift_tables.gaps_frame(self.analysed),
            "motion": lift_tables.motion_frame(self.analysed),
            "landmarks": lift_tables.landmarks_frame(self.analysed),
        }
        for name, frame in tables.items():
            yield f"{name}.csv", frame.assign(**label)
        rules = self.settings.events.model_dump(mode="json")
        in_file = {"file": self._file_events} if self._file_events else {}
        yield "events.json", {"lift": self.name, "events": self.events, **in_file, "rules": rules, **label}
        file = Path(self.quality.file).name  # independent of the folder of the recordings
        yield "quality.json", {"lift": self.name, **self.quality.to_dict(), "file": file, **label}
        yield "pendulum.json", {**self.facts, **label}

    def __str__(self) -> str:
        return "\n".join([self.recording_summary, *self._describe_missing_pendulums()])

    @property
    def recording_summary(self) -> str:
        """Events of the recording with their sources and bounds, and findings."""
        recording, events = self.analysed.recording, self.analysed.events
        _, carried = event_rules.locate_load(recording)
        lines, is_by_hands = [], False
        for name, event in events.items():
            if event.time_s is None:
                lines.append(f"{name}: none ({event.how})")
                continue
            source = _SOURCE_TEXTS.get(event.method, "toes" if name == "toe_off" else carried)
            known = event.earliest_s is not None and event.latest_s is not None
            between = f"; {event.earliest_s:.2f} to {event.latest_s:.2f}" if known else ""
            lines.append(f"{name}: {event.time_s:.3f} s ({source}{between})")
            is_by_hands |= source == "hands"
        if is_by_hands:
            lines.append(
                "the hands replace the box, which has no markers; it is not known whether they hold anything"
            )
        warning = event_rules.several_lifts(recording, events, self.settings.events)
        findings = [f"{finding.outcome}: {finding}" for finding in self.quality.findings]
        return "\n".join([*lines, *filter(None, [warning]), *self._file_events, *findings])

    def __repr__(self) -> str:
        return f"<Lift {self.name}>"


_SOURCE_TEXTS = {event_rules.DECLARED: "set by hand", event_rules.IN_FILE: "marked in the file"}
"""Sources of events that are not detected from the box, the hands or the toes."""


def _find_trial(
    subject: SubjectSettings,
    markers: Path,
    box_mass_kg: float | None,
    trial: TrialSettings | str | None = None,
) -> tuple[str, TrialSettings]:
    """Return the trial recorded in a file, with the name of its lift; `box_mass_kg` selects among several.

    Raises
    ------
    InputError
        If no trial or several trials match, with the subject's trials.
    """
    if box_mass_kg is not None and not 0 <= box_mass_kg <= 100:
        raise InputError(f"box_mass_kg is {box_mass_kg:g} kg; allowed: 0 to 100")
    if isinstance(trial, TrialSettings) or not subject.trials:
        if isinstance(trial, str):
            raise InputError(f"{subject.name} has no trials, so none is named {trial!r}")
        if trial is None and box_mass_kg is None:
            raise InputError(
                f"{subject.name} has no trials: give the mass of the box (--box-mass KG; box_mass_kg in Python)"
            )
        chosen = trial or TrialSettings(box_mass_kg=box_mass_kg, markers=markers.name)
        if box_mass_kg is not None:
            chosen = chosen.model_copy(update={"box_mass_kg": box_mass_kg})
        return f"{subject.name}_{chosen.box_mass_kg:g}kg", chosen
    return _listed_trial(subject, markers, box_mass_kg, trial)


def _listed_trial(
    subject: SubjectSettings, markers: Path, box_mass_kg: float | None, trial: str | None
) -> tuple[str, TrialSettings]:
    lifts = subject.lifts
    if trial is not None:
        matches = {name: item for name, item in lifts.items() if name == trial}
        problem = f"no trial of {subject.name} is named {trial!r}"
    else:
        # The trials with the longest common end of the path, at least the name of the file.
        path, common = markers.resolve().parts, {}
        for name, item in lifts.items():
            parts = Path(item.markers).parts
            common[name] = len(parts) if path[-len(parts) :] == parts else int(parts[-1] == path[-1])
        longest = max(common.values())
        matches = {name: lifts[name] for name, length in common.items() if length == longest > 0}
        problem = f"{markers}: no trial of {subject.name} names this file"
    if box_mass_kg is not None and matches:
        problem = f"{markers}: {', '.join(matches)} had no box of {box_mass_kg:g} kg"
        matches = {name: item for name, item in matches.items() if item.box_mass_kg == box_mass_kg}
    if len(matches) == 1:
        return next(iter(matches.items()))
    if matches:
        problem = f"{markers}: several trials of {subject.name} name this file ({', '.join(matches)}); name one of them"
    lines = [f"  - {name}: {item.markers}, box of {item.box_mass_kg:g} kg" for name, item in lifts.items()]
    if trial is None:
        lines.append("'lumbar new-study FOLDER' writes settings and a subject's file for your own recordings")
    raise InputError("\n".join([f"{problem}; its trials are", *lines]))


def _find_static_file(subject: SubjectSettings, trial: TrialSettings, markers: Path) -> Path | None:
    """Return the subject's static trial; its path and the trial's path are relative to the same folder."""
    if subject.static is None:
        return None
    path, parts = markers.resolve(), Path(trial.markers).parts
    root = path.parents[len(parts) - 1] if path.parts[-len(parts) :] == parts else path.parent
    places = [root / subject.static, path.parent / Path(subject.static).name]
    for place in places:
        if place.is_file():
            return place
    expected = " or ".join(map(str, dict.fromkeys(places)))
    raise InputError(
        f"subject.static of {subject.name} is {subject.static}: no such file; expected {expected}"
    )
