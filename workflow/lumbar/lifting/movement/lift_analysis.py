"""Analysis of one lift, from its markers to the pendulums of the deposit by the choices of the study and of the thesis."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError, LumbarError, Problems
from lumbar.lifting.movement import pendulum_states as pendulum
from lumbar.lifting.movement.centre_of_mass import (
    COMS,
    CentreOfMass,
    SegmentTable,
    absent_segments,
    centres_of_mass,
    segment_table,
)
from lumbar.lifting.movement.cleaning import ISLAND, Gap, clean, frames_of_cutoff
from lumbar.lifting.movement.event_detection import find_events
from lumbar.lifting.movement.events import ABSENT, DETECTED, Event
from lumbar.lifting.movement.joint_centres import TrunkPoints, trunk_points
from lumbar.lifting.movement.pendulum_states import THESIS_CHOICE, PendulumStates
from lumbar.lifting.quality.findings import MarkerFinding
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import LiftingSettings, SubjectSettings, TrialSettings

NEW_STUDY = "'lumbar new-study'"
"""Command that writes the aliases of a folder of recordings."""
CUT_OR_KEEP = (
    "cut the recording (window_s of the trial), give the marker an alias of others, or set gaps.longer: keep"
)
"""Remedy for a lift with a gap."""
MAX_SPLINE_S = 1.0
"""Largest value of ``lifting.gaps.maximum_s`` in s."""


@dataclass(frozen=True)
class AnalysedLift:
    """One analysed lift."""

    recording: MarkerRecording
    """Filled and filtered recording in the axes of the planes, with the lift's name, e.g. ``"expert_23kg"``."""
    complete: MarkerRecording
    """Recording of the whole file with gaps filled, not filtered, in the axes of the planes."""
    gaps: list[Gap]
    events: dict[str, Event]
    table: SegmentTable
    points: TrunkPoints
    centres: dict[str, CentreOfMass]
    pivot: np.ndarray | None
    """Shape (n, 3): trajectory of the pivot, metres; None if the recording lacks the pivot's markers."""
    heading: float
    """Angle by which the axes were rotated, radians."""
    states: dict[tuple[str, str], PendulumStates]
    """States of the pendulum, by centre of mass and plane."""
    missing: dict[str, str]
    """Centres of mass without a pendulum, with the reason."""


def analyse_lift(
    recording: MarkerRecording,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    filled: Sequence[Gap] = (),
    findings: Sequence[MarkerFinding] = (),
) -> AnalysedLift:
    """Fill gaps, filter, find the events, the centres of mass and the pendulum's states during the deposit.

    Results that need missing data are left out; `AnalysedLift.events` and `AnalysedLift.missing` have the reasons.

    Parameters
    ----------
    recording : MarkerRecording
        As read.
    subject, trial, settings
        Settings of the study.
    filled : sequence of Gap
        Gaps that were filled while the recording was read, for the report.
    findings : sequence of MarkerFinding
        Findings of the quality checks: frames that they leave out explain missing results.

    Raises
    ------
    InputError
        If the file gives neither an event nor a centre of mass, if declared events contradict the file, or if a gap that matters
        stays open under ``gaps.longer: error``.
    """
    cleaned, window = clean(recording, settings), trial.window_s
    smooth, complete = cut_to_window(cleaned.smooth, trial, settings), cleaned.complete
    gaps = [*filled, *(gap for gap in cleaned.gaps if window is None or _overlaps(gap, *window))]

    events = find_events(smooth, settings.events, trial.events)
    table = segment_table(settings.segments, subject.sex)
    points = _points(smooth, subject, settings)
    missing = absent_segments(points, table)
    times = [event.time_s for event in events.values() if event.time_s is not None]
    if len(missing) == len(COMS) and not times:
        problems = Problems(f"{smooth.source}: neither an event of a lift nor a centre of mass")
        for name, reason in {**missing, "lift_off": events["lift_off"].how}.items():
            problems.add(name, reason)
        if smooth.unused:
            unused = f"markers of the file that no alias names: {', '.join(smooth.unused[:60])}"
            problems.add("", unused, recognised_unaliased(smooth))
        problems.raise_if_any()
    if settings.gaps.longer == "error" and times:
        needed, span = _required_markers(points, table.ends, settings.pivot), (min(times), max(times))
        harmful = [gap for gap in gaps if gap.marker in needed and _overlaps(gap, *span)]
        _reject_open_gaps(smooth, harmful, settings.gaps.maximum_s)

    # The axes of the planes are those of the laboratory, or rotated with the hips at the start of the deposit.
    angle, without_frame = 0.0, None
    if settings.frame != "laboratory" and events["deposit_start"].time_s is not None:
        try:
            angle = pendulum.heading(smooth, events["deposit_start"].time_s)
        except InputError as error:
            without_frame = str(error)
    if angle:
        cosine, sine = np.cos(angle), np.sin(angle)
        axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        smooth, complete = (
            one.replace_positions({name: points @ axes for name, points in one.positions.items()})
            for one in (smooth, complete)
        )
        points = _points(smooth, subject, settings)

    masses, share = (subject.mass_kg, trial.box_mass_kg), settings.box.share
    centres = centres_of_mass(smooth, points, table, masses, share, events)
    pivot, without_pivot = _pivot(smooth, points, settings.pivot)
    reasons = filter(None, (no_deposit(events), without_pivot, without_frame))
    states, errors = _pendulums(smooth, centres, pivot, events, settings, "; ".join(reasons))
    for com, error in errors.items():
        missing[com] = str(error)
        if isinstance(error, pendulum.MissingSamplesError):
            needed = _required_markers(points, table.ends_of(com), settings.pivot)
            ends = points.markers(table.ends_of(com))
            missing[com] += f"; {_reason_for_missing(smooth, needed, ends, error.frames, gaps, findings)}"
    return AnalysedLift(smooth, complete, gaps, events, table, points, centres, pivot, angle, states, missing)


def _pendulums(
    recording: MarkerRecording,
    centres: dict[str, CentreOfMass],
    pivot: np.ndarray | None,
    events: dict[str, Event],
    settings: LiftingSettings,
    without: str,
) -> tuple[dict[tuple[str, str], PendulumStates], dict[str, LumbarError]]:
    """Return the states by centre of mass and plane, and the error by centre without states: `without` if all lack them."""
    states: dict[tuple[str, str], PendulumStates] = {}
    errors: dict[str, LumbarError] = {}
    for com, centre in centres.items():
        position = centre.position_with_box if settings.box.in_position else centre.position
        try:
            if without:
                raise InputError(without)
            start, stop = events["deposit_start"].time_s, events["release"].time_s
            relative = position - pivot
            planar = pendulum.pendulum_states(recording.time, relative, start, stop, settings.points)
        except LumbarError as error:
            errors[com] = error
        else:
            states.update({(com, plane): values for plane, values in planar.items()})
    return states, errors


@dataclass(frozen=True)
class ThesisPendulums:
    """Pendulums of a lift by `THESIS_CHOICE`, for studies that make another choice."""

    states: dict[tuple[str, str], PendulumStates]
    """States of the pendulum, by centre of mass and plane."""
    missing: dict[str, str]
    """Centres of mass without a pendulum, with the reason."""

    @property
    def facts(self) -> dict:
        """Choice, mean lengths in m by centre of mass and plane, and missing centres, as data for JSON."""
        lengths: dict[str, dict[str, float]] = {}
        for (com, plane), states in self.states.items():
            lengths.setdefault(com, {})[plane] = float(states.length.mean())
        return {**vars(THESIS_CHOICE), "length_m": lengths, "missing": self.missing}


def thesis_pendulums(
    lift: AnalysedLift, subject: SubjectSettings, trial: TrialSettings, settings: LiftingSettings
) -> ThesisPendulums | None:
    """Return the pendulums of the deposit by the thesis's choice, in the axes of the study's planes.

    None if the study has the thesis's choice.
    """
    own, events = pendulum.PendulumChoice.from_settings(settings), lift.events
    points, centres = lift.points, lift.centres
    if own == THESIS_CHOICE:
        return None
    if own.segment_ends != THESIS_CHOICE.segment_ends:
        on_skin = settings.model_copy(update={"segment_ends": THESIS_CHOICE.segment_ends})
        points, masses = _points(lift.recording, subject, on_skin), (subject.mass_kg, trial.box_mass_kg)
        centres = centres_of_mass(lift.recording, points, lift.table, masses, settings.box.share, events)
    pivot, without_pivot = _pivot(lift.recording, points, THESIS_CHOICE.pivot)
    rule, start = THESIS_CHOICE.deposit_start, events["deposit_start"]
    if own.deposit_start != rule:
        how = f"by deposit_start: {rule}; otherwise {start.how}"
        method = ABSENT if start.thesis_s is None else DETECTED
        events = {**events, "deposit_start": Event(start.thesis_s, method, how)}
    reason = no_deposit(events) or without_pivot or ""
    states, errors = _pendulums(lift.recording, centres, pivot, events, settings, reason)
    absent = {com: why for com, why in lift.missing.items() if com not in lift.centres}
    absent |= absent_segments(points, lift.table) | {com: str(error) for com, error in errors.items()}
    return ThesisPendulums(states, absent)


def _points(recording: MarkerRecording, subject: SubjectSettings, settings: LiftingSettings) -> TrunkPoints:
    return trunk_points(recording, settings.segment_ends, settings.hip_centres, subject.sex)


def cut_to_window(
    smooth: MarkerRecording, trial: TrialSettings, settings: LiftingSettings
) -> MarkerRecording:
    """Return the trial's window of a filtered recording.

    Parameters
    ----------
    smooth : MarkerRecording
        Filtered recording.
    trial : TrialSettings
        Trial with ``window_s``; None keeps all frames.
    settings : LiftingSettings
        Settings with the filter's cut-off.

    Raises
    ------
    InputError
        If the window has no more frames than the filter needs.
    """
    if trial.window_s is None:
        return smooth
    start, stop = trial.window_s
    inside = (smooth.time >= start) & (smooth.time <= stop)
    shortest = frames_of_cutoff(settings.filter.cutoff_Hz, smooth.rate)
    if inside.sum() <= shortest:
        raise InputError(
            f"{smooth.source}: window_s {start:g} to {stop:g} s holds {inside.sum()} frames of the recording, which runs "
            f"from {smooth.time[0]:g} to {smooth.time[-1]:g} s; more than {shortest} are needed"
        )
    return smooth.select_frames(inside)


def _reject_open_gaps(recording: MarkerRecording, gaps: Sequence[Gap], maximum_s: float) -> None:
    """Raise an error that lists the gaps that stay open, with a remedy."""
    problems = Problems(recording.source)
    for gap in (gap for gap in gaps if not gap.filled):
        evidence = f"not seen for {gap.length_s:.3g} s from {gap.start_s:.3f} s ({gap.outcome})"
        problems.add(gap.marker, evidence)
    if problems.entries:
        problems.add("", f"gaps up to {maximum_s:g} s between seen frames are filled", CUT_OR_KEEP)
    problems.raise_if_any()


def recognised_unaliased(recording: MarkerRecording) -> str:
    """Return a remedy for markers with a known meaning and no alias; empty if there are none."""
    known = [name for name in landmarks(recording.unused) if name in recording.absent]
    return f"{NEW_STUDY} writes aliases for those that are recognised: {', '.join(known)}" if known else ""


def _required_markers(points: TrunkPoints, ends: Sequence[str], pivot: str) -> list[str]:
    """Return the markers from which some ends of segments and the pivot are computed."""
    return list(dict.fromkeys([*pendulum.PIVOTS[pivot], *points.markers([*ends, *pendulum.PIVOTS[pivot]])]))


def no_deposit(events: dict[str, Event]) -> str | None:
    """Return the reason why the deposit is not known; None if it is."""
    lacking = [
        f"{name}: {events[name].how}" for name in ("deposit_start", "release") if events[name].time_s is None
    ]
    return f"the deposit is not known: {'; '.join(lacking)}" if lacking else None


def _pivot(
    recording: MarkerRecording, points: TrunkPoints, pivot: str
) -> tuple[np.ndarray | None, str | None]:
    """Return the pivot's trajectory, or the reason why it is unknown."""
    try:
        return pendulum.pivot_trajectory(recording, points, pivot), None
    except InputError as error:
        return None, str(error)


def _overlaps(item: Gap | MarkerFinding, start: float, stop: float) -> bool:
    """Return whether a gap or a finding overlaps the interval between two times in seconds."""
    return item.start_s <= stop and item.start_s + item.length_s > start


def _reason_for_missing(
    recording: MarkerRecording,
    needed: Collection[str],
    ends: Collection[str],
    frames: np.ndarray,
    gaps: Sequence[Gap],
    findings: Sequence[MarkerFinding],
) -> str:
    """Return the markers missing in some frames, with a remedy for frames that findings leave out and for gaps of the file.

    `needed` are the markers from which the samples are computed, `ends` the markers among them that segments need.
    """
    start, stop = recording.time[frames[[0, -1]]]
    hidden = [name for name in needed if name in recording and not np.isfinite(recording[name][frames]).all()]
    causes = [one for one in findings if _overlaps(one, start, stop) and set(hidden) & set(one.concerns)]
    left_out = {
        (name, frame)
        for finding in causes
        for name in finding.concerns
        for frame in range(finding.frames.start, finding.frames.stop)
    }
    # Gaps of the file itself: not all of their frames were left out by findings.
    open_gaps = [
        gap
        for gap in gaps
        if gap.marker in hidden and not gap.filled and gap.outcome != ISLAND and _overlaps(gap, start, stop)
        if not {(gap.marker, gap.first_frame + frame) for frame in range(gap.n_frames)} <= left_out
    ]
    gappy = sorted({gap.marker for gap in open_gaps})
    reasons = [
        f"left out by the quality checks: {', '.join(finding.markers)} from {finding.start_s:.2f} to "
        f"{finding.start_s + finding.length_s:.2f} s ({finding.kind}): {finding.remedy}"
        for finding in causes
    ]
    if gappy or not causes:
        longest_s = max((gap.length_s for gap in open_gaps), default=0.0)
        remedies = ["fill them in the capture software"]
        if longest_s <= MAX_SPLINE_S:
            remedies = [f"raise lifting.gaps.maximum_s (a spline over {longest_s:.2g} s is a guess)"]
        # Another pivot helps only if no segment needs the markers.
        remedies += ["use another pivot"] if not set(gappy) & set(ends) else []
        if gappy and all(name.endswith(("ASIS", "PSIS")) for name in gappy):
            remedies.append("set lifting.segment_ends: skin, which needs no ASIS and PSIS")
        where = f"not seen in the file: {', '.join(gappy)}: " if gappy else ""
        reasons.append(where + ", or ".join(remedies))
    return "; ".join(reasons)
