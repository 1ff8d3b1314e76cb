"""``lumbar.lift``: which trial a marker file is the recording of, and from its markers to the pendulums of the deposit."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.interface.verb import Result, data_label
from lumbar.lifting.movement import lift_analysis as lifting
from lumbar.lifting.movement import lift_tables
from lumbar.lifting.movement.event_detection import several_lifts
from lumbar.lifting.movement.events import comparison, event_sources
from lumbar.lifting.movement.rigid_filling import BodyFilling
from lumbar.lifting.quality.screening import QualitySheet, Screening, naming, read_screened
from lumbar.records.markers import MarkerRecording, read_markers
from lumbar.settings.layout import MarkerLayout
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.subject import SubjectSettings, TrialSettings

if TYPE_CHECKING:
    import pandas as pd


def lift(
    markers: str | os.PathLike,
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
    markers : path
        C3D, TRC, CSV or BVH file, also packed (``.gz``).
    subject : SubjectSettings or path
        The person: settings, or a file as in ``config/subjects``.
    box_mass_kg : float, optional
        Mass of the box; default that of the trial.
    trial : TrialSettings or str, optional
        The trial, or the name of its lift, as ``ann_15kg_2``; default the one among the subject's trials whose marker
        file this is. A subject without trials needs none.
    name : str, optional
        Name of the lift; default that of the trial, as in a study.
    static : path, optional
        Marker file of a static trial; default the subject's, looked for below the folder that the trial's file lies below.
    source_label : str
        Words for the source of the data; default the folder or file they were read from.

    Raises
    ------
    InputError, NumericalError
        Naming the file and what is wrong with it.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_lift
    >>> somebody = example_lift("lift.c3d")
    >>> print(lumbar.lift("lift.c3d", somebody, box_mass_kg=15))
    lift_off: 2.310 s (box; 2.27 to 2.36)
    toe_off: 3.930 s (toes)
    deposit_start: 5.820 s (box; 5.78 to 6.06)
    release: 7.070 s (box)
    """
    subject = subject_of(subject)
    settings = settings or LiftingSettings()
    found, trial = trial_of(subject, Path(markers), box_mass_kg, trial)
    name = name or found
    settings = settings.of_trial(trial)
    static = static or _beside(f"subject.static of {subject.name}", subject.static, trial, Path(markers))
    standing = (
        None if static is None else labelled_markers(static, settings.markers, subject.height_m).positions
    )
    bodies = BodyFilling(settings, standing)
    recording, sheet = read_screened(markers, settings.markers, name, subject.height_m, bodies)
    sheet = replace(sheet, findings=(*sheet.findings, *bodies.findings))
    analysed = lifting.analyse_lift(recording, name, subject, trial, settings, bodies.gaps, sheet.findings)
    source_label = data_label(source_label, [recording.source])
    return Lift(analysed, subject, trial, settings, source_label, sheet)


def labelled_markers(path: str | os.PathLike, layout: MarkerLayout, height_m: float) -> MarkerRecording:
    """Markers of a file by their own labels, in metres and standard axes, without what cannot be a body's."""
    bare = layout.model_copy(update={"aliases": {}, "required": None, "check_axes": False})
    screening = Screening(height_m, layout.aliases)
    with naming(path):
        return read_markers(path, bare, minimum_frames=1, screen=screening)


def subject_of(subject: SubjectSettings | str | os.PathLike) -> SubjectSettings:
    """Return the person, read from a file where one is given."""
    if isinstance(subject, SubjectSettings):
        return subject
    from lumbar.study.load_study import load_subject

    return load_subject(Path(subject))


@dataclass(frozen=True, eq=False, repr=False)
class Lift(Result):
    """One analysed lift."""

    shown = "event_rows"
    analysed: lifting.AnalysedLift
    """Events, centres of mass, pendulum states."""
    subject: SubjectSettings
    trial: TrialSettings
    settings: LiftingSettings
    source_label: str
    quality: QualitySheet
    """What is in the recording and what in it cannot be a body: such stretches were left out."""

    @property
    def name(self) -> str:
        """Name of the lift, e.g. ``"expert_23kg"``."""
        return self.analysed.name

    @cached_property
    def states(self) -> pd.DataFrame:
        """Pendulum states of the deposit: one row per centre of mass, plane and instant."""
        return lift_tables.states_frame(self.analysed.states)

    @cached_property
    def facts(self) -> dict:
        """What the pendulums are made of: masses, lengths, pivots, rules, assumptions; and what measures need beside."""
        return {
            **lift_tables.summary(self.analysed, self.subject, self.trial, self.settings),
            "thesis_pendulum": self._in_thesis and self._in_thesis.facts,
            "height_m": self.subject.height_m,
            "no_deposit": lifting.no_deposit(self.analysed.events),
            "missing_points": self._body[1],
        }

    @cached_property
    def _in_thesis(self) -> lifting.ThesisPendulums | None:
        return lifting.thesis_pendulums(self.analysed, self.subject, self.trial, self.settings)

    @cached_property
    def thesis_states(self) -> pd.DataFrame:
        """Pendulum states by the thesis's pivot, segment ends and start of the deposit; no rows if the study's are these."""
        return lift_tables.states_frame(self._in_thesis.states if self._in_thesis else {})

    @cached_property
    def _body(self) -> tuple[pd.DataFrame, dict[str, str]]:
        return lift_tables.body_frame(self.analysed)

    @property
    def body(self) -> pd.DataFrame:
        """Trajectories of joints, feet, hands, load and centres of mass: ``lumbar.lifting.movement.lift_tables.body_frame``."""
        return self._body[0]

    @property
    def checks(self) -> list[str]:
        """Return lines on segment ends on the skin."""
        points, ends = self.analysed.points, self.analysed.table.ends
        return points.on_skin(ends) if self.settings.segment_ends == "inner" else []

    @property
    def without_pendulum(self) -> list[str]:
        """Indented lines on centres of mass without a pendulum, and on what would give them markers."""
        reasons = [
            *without_pendulum(self.analysed.missing),
            lifting.recognised_unaliased(self.analysed.recording),
        ]
        return [f"  {line}" for reason in reasons for line in reason.splitlines()]

    @property
    def doubt(self) -> str:
        """Whether the recording may hold several lifts; empty where not."""
        return several_lifts(self.analysed.recording, self.analysed.events, self.settings.events)

    @property
    def file_events(self) -> list[str]:
        """Lines on the events that the file itself holds, beside those detected."""
        return comparison(self.analysed.recording, self.analysed.events, self.settings.events.labels)

    def event_rows(self) -> list[dict]:
        """The events, in the order in which they happen."""
        return [event.as_dict() for event in self.analysed.events.values()]

    def files(self) -> Iterator[tuple[str, Any]]:
        """``pendulum``, ``thesis_pendulum``, ``com``, ``body``, ``events``, ``gaps``, ``quality``, for figures."""
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
        events = {name: event.as_dict() for name, event in self.analysed.events.items()}
        rules = self.settings.events.model_dump(mode="json")
        in_file = {"file": self.file_events} if self.file_events else {}
        yield "events.json", {"lift": self.name, "events": events, **in_file, "rules": rules, **label}
        file = Path(self.quality.file).name  # the same wherever recordings lie
        yield "quality.json", {"lift": self.name, **self.quality.as_dict(), "file": file, **label}
        yield "pendulum.json", {**self.facts, **label}

    def __str__(self) -> str:
        return "\n".join([self.seen, *without_pendulum(self.analysed.missing)])

    @property
    def seen(self) -> str:
        """What was found in the recording: its events, and what cannot be a body's."""
        findings = [f"{finding.outcome}: {finding}" for finding in self.quality.findings]
        return "\n".join([*self._events_in_words(), *findings])

    def _events_in_words(self) -> list[str]:
        """Each event, what it was found in, between which times it must lie; and what hands leave open."""
        sources, lines = event_sources(self.analysed.recording, self.analysed.events), []
        for name, event in self.analysed.events.items():
            if event.time_s is None:
                lines.append(f"{name}: none ({event.how})")
                continue
            known = event.earliest_s is not None and event.latest_s is not None
            between = f"; {event.earliest_s:.2f} to {event.latest_s:.2f}" if known else ""
            lines.append(f"{name}: {event.time_s:.3f} s ({sources[name]}{between})")
        if "hands" in sources.values():
            lines.append(
                "the hands stand for the box, which has no markers; whether they hold anything is not known"
            )
        return [*lines, *filter(None, [self.doubt]), *self.file_events]

    def __repr__(self) -> str:
        return f"<Lift {self.name}>"


def without_pendulum(missing: Mapping[str, str]) -> list[str]:
    """Say once which centres of mass have no pendulum for the same reason."""
    coms: dict[str, list[str]] = {}
    for com, reason in missing.items():
        coms.setdefault(reason, []).append(com)
    return [f"no pendulum of {', '.join(names)}: {reason}" for reason, names in coms.items()]


def trial_of(
    subject: SubjectSettings,
    markers: Path,
    box_mass_kg: float | None,
    trial: TrialSettings | str | None = None,
) -> tuple[str, TrialSettings]:
    """Return the trial that a file is the recording of, with the name of its lift.

    `trial` is the trial itself, or the name of its lift; `box_mass_kg` picks among several lifts of the same file.

    Raises
    ------
    InputError
        Listing the subject's trials, if none or several of them fit: events declared for another file are another
        lift's.
    """
    if box_mass_kg is not None and not 0 <= box_mass_kg <= 100:
        raise InputError(f"mass of the box is {box_mass_kg:g} kg; allowed: 0 to 100")
    if isinstance(trial, TrialSettings) or not subject.trials:
        if isinstance(trial, str):
            raise InputError(f"{subject.name} has no trials, so none is named {trial!r}")
        if trial is None:
            if box_mass_kg is None:
                raise InputError(
                    f"{subject.name} has no trials: give the mass of the box (--box-mass KG; box_mass_kg in Python)"
                )
            trial = TrialSettings(box_mass_kg=box_mass_kg, markers=markers.name)
        chosen = trial if box_mass_kg is None else trial.model_copy(update={"box_mass_kg": box_mass_kg})
        return f"{subject.name}_{chosen.box_mass_kg:g}kg", chosen
    lifts = lift_names(subject)
    if trial is not None:
        fitting = {name: item for name, item in lifts.items() if name == trial}
        sought = f"no trial of {subject.name} is named {trial!r}"
    else:
        fitting = _recorded_in(lifts, markers)
        sought = f"{markers}: no trial of {subject.name} names this file"
    if box_mass_kg is not None and fitting:
        others = fitting
        fitting = {name: item for name, item in others.items() if item.box_mass_kg == box_mass_kg}
        sought = f"{markers}: {', '.join(others)} had no box of {box_mass_kg:g} kg"
    if len(fitting) == 1:
        return next(iter(fitting.items()))
    if fitting:
        sought = f"{markers}: several trials of {subject.name} name this file ({', '.join(fitting)}); name one of them"
    listed = "\n".join(
        f"  - {name}: {item.markers}, box of {item.box_mass_kg:g} kg" for name, item in lifts.items()
    )
    own = (
        "\n'lumbar new-study FOLDER' writes settings and a person's file for recordings of your own"
        if trial is None
        else ""
    )
    raise InputError(f"{sought}; its trials are\n{listed}{own}")


def lift_names(subject: SubjectSettings) -> dict[str, TrialSettings]:
    """Trials of one person by the names that a study gives their lifts."""
    from lumbar.study.load_study import name_lifts

    return {name: lift.trial for name, lift in name_lifts({subject.name: subject}).items()}


def _recorded_in(lifts: dict[str, TrialSettings], markers: Path) -> dict[str, TrialSettings]:
    """Lifts whose marker file this is: by as much of the path as both have, by the name at least."""
    path = markers.resolve().parts

    def shared(trial: TrialSettings) -> int:
        parts = Path(trial.markers).parts
        if path[-len(parts) :] == parts:
            return len(parts)
        return 1 if parts[-1] == path[-1] else 0

    lengths = {name: shared(trial) for name, trial in lifts.items()}
    longest = max(lengths.values())
    return {name: lifts[name] for name, length in lengths.items() if length == longest > 0}


def _beside(key: str, named: str | None, trial: TrialSettings, markers: Path) -> Path | None:
    """Return a file that is named relative to the folder which the trial's file is named relative to."""
    if named is None:
        return None
    path, parts = markers.resolve(), Path(trial.markers).parts
    root = path.parents[len(parts) - 1] if path.parts[-len(parts) :] == parts else path.parent
    places = [root / named, path.parent / Path(named).name]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise InputError(
            f"{key} is {named}, and there is no file " + " or ".join(map(str, dict.fromkeys(places)))
        )
    return found
