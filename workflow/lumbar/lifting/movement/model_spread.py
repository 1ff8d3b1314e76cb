"""How far the trunk's centre of mass and its pendulum depend on choices: segment table, segment ends, hips, cut-off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError, LumbarError
from lumbar.lifting.movement.centre_of_mass import SegmentTable, all_tables, segment_centres, trunk_centre
from lumbar.lifting.movement.cleaning import filter_without_islands
from lumbar.lifting.movement.joint_centres import (
    HIP_RULES,
    INNER,
    MID_HIP,
    SKIN,
    TrunkPoints,
    trunk_points,
    unit,
)
from lumbar.lifting.movement.pendulum_states import pivot_trajectory
from lumbar.records.markers import MarkerRecording
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

if TYPE_CHECKING:
    from lumbar.lifting.movement.lift import AnalysedLift
    from lumbar.settings.lifting import FilterSettings, LiftingSettings
    from lumbar.settings.subject import SubjectSettings

CUTOFFS_HZ = (4.0, 6.0, 8.0)
REFERENCE = "reference"


@dataclass(frozen=True)
class _Choice:
    name: str
    recording: MarkerRecording
    table: SegmentTable
    ends: str
    hips: str

    def same_as(self, other: _Choice) -> bool:
        """Whether both make the same centre of mass, whatever their names."""
        settings = (self.table, self.ends, self.hips) == (other.table, other.ends, other.hips)
        return settings and self.recording is other.recording


def model_spread(lift: AnalysedLift, subject: SubjectSettings, settings: LiftingSettings) -> pd.DataFrame:
    """Compare other choices with the one that the result stands on.

    Segments of different tables are cut at different heights, so that what is compared is the common centre of thorax,
    abdomen and pelvis, without the box, from the start of the deposit to the release, or over the whole recording where
    there is no deposit. One row per choice, columns those of ``spread.csv``.
    """
    own = _Choice("result", lift.recording, lift.table, settings.segment_ends, settings.hip_centres)
    frames, rows = _frames(lift), []
    try:
        reference = _motion(own, lift, subject, settings, frames)
    except LumbarError as error:
        return pd.DataFrame([{"choice": "result", "note": str(error)}], columns=_columns())
    forward = unit(np.cross([0.0, 0.0, 1.0], lift.points.right) * [1.0, 1.0, 0.0])[frames]
    for choice in _choices(lift, own, subject, settings):
        try:
            differences = _differences(reference, _motion(choice, lift, subject, settings, frames), forward)
            note = REFERENCE if choice.same_as(own) else _empty_cells(differences)
            rows.append({"choice": choice.name, **differences, "note": note})
        except LumbarError as error:
            rows.append({"choice": choice.name, "note": str(error)})
    return pd.DataFrame(rows, columns=_columns())


def _columns() -> list[str]:
    """Columns of one lift's choices."""
    return columns_of(__file__, "spread")[1:]


def _frames(lift: AnalysedLift) -> slice:
    start, stop = (lift.events[name].time_s for name in ("deposit_start", "release"))
    if start is None or stop is None:
        return slice(None)
    first, last = np.searchsorted(lift.recording.time, (start, stop))
    return slice(int(first), int(last) + 1)


def _choices(
    lift: AnalysedLift, own: _Choice, subject: SubjectSettings, settings: LiftingSettings
) -> Iterator[_Choice]:
    for table in all_tables(subject.sex):
        yield _Choice(f"{table.name}, {own.ends}", own.recording, table, own.ends, own.hips)
    other = SKIN if own.ends == INNER else INNER
    if not own.recording.joints:
        yield _Choice(f"{own.table.name}, {other}", own.recording, own.table, other, own.hips)
    for hips in () if own.recording.joints else HIP_RULES:
        # A regression lacks markers that another one does without: hips are then the skin's, or not there.
        middle = trunk_points(own.recording, INNER, hips, subject.sex).points.get(MID_HIP)
        if own.ends == INNER and middle is not None and middle.inner:
            yield _Choice(f"hips {hips}", own.recording, own.table, own.ends, hips)
    needed = {name for point in lift.points.points.values() for name in point.markers}
    needed |= {"L_ANKLE", "R_ANKLE"} & set(lift.complete.positions)
    for cutoff in CUTOFFS_HZ:
        if cutoff < lift.complete.rate / 2:
            same = cutoff == settings.filter.cutoff_Hz
            other = replace(settings.filter, cutoff_Hz=cutoff)
            smooth = own.recording if same else _filtered(lift, needed, other)
            yield _Choice(f"cut-off {cutoff:g} Hz", smooth, own.table, own.ends, own.hips)


def _filtered(lift: AnalysedLift, names: set[str], settings: FilterSettings) -> MarkerRecording:
    """The needed markers filtered with another cut-off, at the instants of the result."""
    complete = lift.complete
    few = replace(complete, positions={name: complete.positions[name] for name in sorted(names)})
    smooth, _, _ = filter_without_islands(few, settings)
    first = int(np.searchsorted(complete.time, lift.recording.time[0]))
    return smooth.at(slice(first, first + len(lift.recording)))


def _motion(
    choice: _Choice, lift: AnalysedLift, subject: SubjectSettings, settings: LiftingSettings, frames: slice
) -> tuple[np.ndarray, ...]:
    """Place, velocity, angle and angular velocity of the trunk's common centre during the deposit; arrays over frames."""
    recording = choice.recording
    points: TrunkPoints = trunk_points(recording, choice.ends, choice.hips, subject.sex)
    centre = trunk_centre(segment_centres(points, choice.table), choice.table)
    relative = centre - pivot_trajectory(recording, points, settings.pivot)
    if not np.isfinite(relative[frames]).all(axis=1).any():
        raise InputError("trunk and pivot are not seen together")
    (ahead, above), rate = relative[:, 1:].T, recording.rate
    ahead_rate, above_rate = np.gradient(relative[:, 1:], 1 / rate, axis=0).T
    spin = (ahead_rate * above - ahead * above_rate) / (ahead**2 + above**2)
    values = (centre, np.gradient(centre, 1 / rate, axis=0), np.arctan2(ahead, above), spin)
    return tuple(value[frames] for value in values)


def _differences(reference, other, forward: np.ndarray) -> dict[str, float | None]:
    """Differences of two motions where both are known; None for what is known at no such instant."""
    moved, velocity, turned, spin = (there - here for here, there in zip(reference, other, strict=True))
    moved = 1e3 * moved
    if not np.isfinite(moved).all(axis=1).any():
        raise InputError("it and the result are known at no common instant")
    turned = np.angle(np.exp(1j * turned))
    speed = 1e3 * np.linalg.norm(velocity, axis=1)
    return {
        "forward_mm": _mean(np.sum(moved * forward, axis=1)),
        "up_mm": _mean(moved[:, 2]),
        "distance_mm": _mean(np.linalg.norm(moved, axis=1)),
        "speed_rms_mm_s": _root_mean_square(speed),
        "angle_rad": _mean(turned),
        "angle_rms_rad": _root_mean_square(turned),
        "angular_velocity_rms_rad_s": _root_mean_square(spin),
    }


def _mean(values: np.ndarray) -> float | None:
    return float(np.nanmean(values)) if np.isfinite(values).any() else None


def _root_mean_square(values: np.ndarray) -> float | None:
    square = _mean(values**2)
    return None if square is None else float(np.sqrt(square))


def _empty_cells(differences: dict[str, float | None]) -> str | None:
    """Why numbers are missing."""
    reasons = {
        "forward_mm": "the person's right is not seen: no forward",
        "speed_rms_mm_s": "no three successive instants in common: no velocities",
        "angle_rad": "the pivot is not known at any common instant: no angles",
    }
    return "; ".join(text for name, text in reasons.items() if differences[name] is None) or None


def spread_lines(spread: pd.DataFrame) -> list[str]:
    """Say in lines what the choices change, in millimetres and radians, and once against which."""
    own = spread.loc[spread["note"] == REFERENCE, "choice"]
    lines = [f"other choices against {'; '.join(own)}:"] if len(own) else []
    for row in spread[spread["note"] != REFERENCE].itertuples():
        if row.distance_mm is None or np.isnan(row.distance_mm):
            lines.append(f"{row.choice}: not possible ({row.note})")
            continue
        centre = f"centre {_shown(row.forward_mm, '+.0f')} mm forward, {row.up_mm:+.0f} mm up"
        rates = f"RMS of speed {_shown(row.speed_rms_mm_s, '.1f')} mm/s"
        spin = f"of θ' {_shown(row.angular_velocity_rms_rad_s, '.3f')} rad/s"
        why = f" ({row.note})" if isinstance(row.note, str) else ""
        lines.append(f"{row.choice}: {centre}; θ {_shown(row.angle_rad, '+.3f')} rad; {rates}, {spin}{why}")
    return lines


def _shown(number: float | None, digits: str) -> str:
    return "?" if number is None or np.isnan(number) else format(number, digits)


def spread_table(spreads: Sequence[pd.DataFrame], facts: Sequence[Mapping], data: str) -> Table:
    """Return the choices of all lifts as a published table, with the segment ends on the skin below it.

    There is one table of `model_spread` per lift, and beside it the facts of its ``pendulum.json``.
    """
    rows = [frame.assign(lift=fact["lift"]) for frame, fact in zip(spreads, facts, strict=True)]
    frame = pd.concat(rows, ignore_index=True)[columns_of(__file__, "spread")]
    notes = []
    for fact in facts:
        skin = [text for text in fact["segments"]["points"].values() if "mm from the joint's centre" in text]
        if skin:
            notes.append(f"{fact['lift']}: {'; '.join(skin)}")
    return described(__file__, "spread", frame, data, notes=tuple(notes))
