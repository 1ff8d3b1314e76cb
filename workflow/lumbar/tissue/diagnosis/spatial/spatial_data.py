"""Records of several axes as a fit sees them: axes are fitted together and whitened and judged each by its own noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.frames import rotate_forces
from lumbar.records.record import Record, require_clock, require_same_units
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.fitting.fit_data import FitData, JointData
from lumbar.tissue.diagnosis.fitting.preparation import (
    Experiment,
    assemble_experiment,
    check_unseen,
    choose_training,
    resting_position,
    settling_samples,
)
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor, noise_floor
from lumbar.tissue.diagnosis.noise.periods import MIN_FULL_PERIODS, find_period
from lumbar.tissue.diagnosis.sensors.sensor_faults import repair
from lumbar.tissue.models.motion import Motion, SpatialMotion


@dataclass(frozen=True, eq=False)
class SpatialData(JointData):
    """One record of several axes; its signals stand one axis after the other, and each axis is a part."""

    @classmethod
    def along(
        cls, record: Record, whitening: Sequence[np.ndarray], settling: int, rests: Sequence[float]
    ) -> Self:
        """A record with the whitening of every axis and its position at rest, and samples at its start that count for nothing."""
        parts = [
            FitData(record.name, Motion.of(one, offset=rest), one["output"], taps, settling)
            for one, taps, rest in zip(map(record.axis, record.axes), whitening, rests, strict=True)
        ]
        return cls.join(parts, record.axes)

    @classmethod
    def join(cls, parts: list[FitData], axes: tuple[str, ...] = ()) -> Self:
        """Put axes together."""
        joint = super().join(parts)
        motion = SpatialMotion(tuple(part.motion for part in parts), names=axes)  # type: ignore[misc]
        return replace(joint, name=parts[0].name, motion=motion)

    def _rebuild(self, parts: list[FitData]) -> Self:
        assert isinstance(self.motion, SpatialMotion)
        return replace(type(self).join(parts, self.motion.names), has_own_zero=self.has_own_zero)

    @property
    def records(self) -> tuple[FitData, ...]:
        """The record."""
        return (self,)

    @cached_property
    def zeros(self) -> np.ndarray:
        """Columns of the zeros of the sensor's channels, shape (axes × samples, axes)."""
        return np.kron(np.eye(len(self.parts)), np.ones((len(self.parts[0].force), 1)))

    def drop_history(self, signal: np.ndarray) -> np.ndarray:
        """Signal over the record itself, one axis after the other."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.drop_history(piece) for part, piece in pieces])

    def longest_record(self, signal: np.ndarray) -> tuple[Motion, np.ndarray]:
        """Motion along the axis on which a signal is largest, and the signal there."""
        assert isinstance(self.motion, SpatialMotion)
        pieces = zip(self.motion.parts, self.motion.split(signal), strict=True)
        return max(pieces, key=lambda pair: float(np.var(pair[1])))

    def _about_zero(self, errors: np.ndarray) -> np.ndarray:
        if not self.has_own_zero:
            return errors
        return np.concatenate([piece - piece.mean() for piece in self.split_records(errors)])


def prepare(records: list[Record], settings: DiagnosisSettings) -> Experiment:
    """Prepare records of the same axes for diagnosis, faults of their sensors repaired.

    Raises
    ------
    InputError
        Different axes or units, a record that is too short, training records that are not there.
    """
    require_clock(records)
    require_same_units(records)
    if settings.session or settings.forward or settings.load_drives:
        key = "session" if settings.session else "forward"
        raise InputError(
            f"improvement.{key}: records of several axes begin at rest and have the position as input"
        )
    _check_channels(records)
    sound, faults = _repaired([rotate_forces(record, settings.force_frame) for record in records])
    chosen, others = choose_training(sound, settings.train)
    first = chosen[0]
    check_unseen(chosen, others)
    floors = axis_floors(first)
    rests = resting_position([record.stacked("input") for record in (*chosen, *others)]).tolist()
    known = [floor for floor in floors if floor is not None]
    white = [np.ones(1)] * len(floors)

    def data(record: Record) -> SpatialData:
        alike = known and np.isclose(record.sampling_time, first.sampling_time)
        taps = [floor.whitening for floor in known] if alike else white
        return SpatialData.along(record, taps, settling_samples(record.widest, settings.settling_s), rests)

    return assemble_experiment(
        first.widest,
        list(map(data, chosen)),
        list(map(data, others)),
        NoiseFloor.together(known) if known else None,
        rest=tuple(rests),
        records=tuple(sound),
        faults=tuple(faults),
        settling_s=settings.settling_s,
    )


def _check_channels(records: Sequence[Record]) -> None:
    """Refuse a force that does not change along an axis which some record moves along."""
    for axis in records[0].axes:
        moved = [record for record in records if axis in record.moving]
        dead = [record.name for record in moved if np.ptp(record[f"output_{axis}"]) == 0]
        if dead:
            unit = records[0].channels[f"output_{axis}"].unit
            raise InputError(
                f"{', '.join(dead)}: the force along {axis} is {moved[0][f'output_{axis}'][0]:g} {unit} throughout, though the "
                f"position moves: look for a channel that was not connected, or leave the columns of {axis} out"
            )


def axis_record(record: Record, axis: str) -> Record:
    """The record of one axis, which it has behind its name."""
    return replace(record.axis(axis), name=f"{record.name} ({axis})")


def _repaired(records: list[Record]) -> tuple[list[Record], list[Finding]]:
    """Records and findings of their sensors, axis by axis; a finding's record has the axis behind its name."""
    sound, faults = list(records), []
    for axis in records[0].axes:
        single = [axis_record(record, axis) for record in records]
        moving = [index for index, record in enumerate(records) if axis in record.moving]
        repaired, found = repair([single[index] for index in moving])
        faults += found
        for index, record in zip(moving, repaired, strict=True):
            values = {f"{role}_{axis}": record[role] for role in ("input", "output")}
            sound[index] = sound[index].with_values(**values)
    return sound, faults


def axis_floors(record: Record) -> list[NoiseFloor] | list[None]:
    """Noise floor of every axis of a record; None of all where its motion does not repeat."""
    period = record.period or find_period(record) or find_period(record, MIN_FULL_PERIODS - 1)
    still = record.widest["input"]  # which repeats where noise of an axis that rests does not
    single = [
        one if axis in record.moving else one.with_values(input=still)
        for axis, one in zip(record.axes, map(record.axis, record.axes), strict=True)
    ]
    found = [noise_floor(one, period) for one in single if period]
    known = [floor for floor in found if floor is not None]
    return known if len(known) == len(record.axes) else [None] * len(record.axes)
