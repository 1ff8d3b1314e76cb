"""Preparation of records of several axes: the axes are fitted together, each with its own noise and sensor faults."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record, require_clock, require_same_units
from lumbar.records.sampling import rotate_forces
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
    """One record of several axes, with a part per axis; a signal has the samples of one axis after those of another axis."""

    @classmethod
    def join(cls, parts: list[FitData], has_own_zero: bool = False, axes: tuple[str, ...] = ()) -> Self:
        """Return the record with these parts; `axes` has the names of their axes."""
        joint = super().join(parts, has_own_zero)
        motion = SpatialMotion(tuple(part.motion for part in parts), names=axes)  # type: ignore[misc]
        return replace(joint, name=parts[0].name, motion=motion)

    def _rebuild(self, parts: list[FitData]) -> Self:
        assert isinstance(self.motion, SpatialMotion)
        return type(self).join(parts, self.has_own_zero, self.motion.names)

    @property
    def records(self) -> tuple[FitData, ...]:
        """The records that are fitted together: only this record."""
        return (self,)

    @cached_property
    def zeros(self) -> np.ndarray:
        """Columns of the zeros of the sensor's channels, shape (axes × samples, axes)."""
        return np.kron(np.eye(len(self.parts)), np.ones((len(self.parts[0].force), 1)))

    def drop_history(self, signal: np.ndarray) -> np.ndarray:
        """Return the part of a signal that belongs to the record itself, one axis after the other."""
        pieces = zip(self.parts, self.motion.split(signal), strict=True)
        return np.concatenate([part.drop_history(piece) for part, piece in pieces])

    def _about_zero(self, errors: np.ndarray) -> np.ndarray:
        if not self.has_own_zero:
            return errors
        return np.concatenate([piece - piece.mean() for piece in self.split_records(errors)])


def prepare(records: list[Record], settings: DiagnosisSettings) -> Experiment:
    """Prepare records of the same axes for diagnosis and repair the faults of their sensors, axis by axis.

    Raises
    ------
    InputError
        For different axes or units, too short records, missing training records, or a force that does not change along an axis
        with motion.
    """
    require_clock(records)
    require_same_units(records)
    if settings.session or settings.forward or settings.load_drives:
        key = "session" if settings.session else "forward"
        raise InputError(
            f"improvement.{key}: records of several axes begin at rest and have the position as input"
        )
    axes = records[0].axes
    for axis in axes:
        moving = [record for record in records if axis in record.moving]
        constant = [record.name for record in moving if np.ptp(record[f"output_{axis}"]) == 0]
        if constant:
            channel = moving[0].channels[f"output_{axis}"]
            raise InputError(
                f"{', '.join(constant)}: the force along {axis} is {channel.values[0]:g} {channel.unit} throughout, though the "
                f"position moves. Check whether the channel was connected, or leave the columns of {axis} out."
            )
    records, faults = [rotate_forces(record, settings.force_frame) for record in records], []
    for axis in axes:
        moving = [index for index, record in enumerate(records) if axis in record.moving]
        repaired, findings = repair([axis_record(records[index], axis) for index in moving])
        faults += findings
        for index, record in zip(moving, repaired, strict=True):
            values = {f"{role}_{axis}": record[role] for role in ("input", "output")}
            records[index] = records[index].with_values(**values)
    chosen, others = choose_training(records, settings.train)
    first = chosen[0]
    check_unseen(chosen, others)
    floors = axis_floors(first)
    rests = resting_position([record.stacked("input") for record in (*chosen, *others)]).tolist()
    known = [floor for floor in floors if floor is not None]

    def data(record: Record) -> SpatialData:
        taps = [np.ones(1)] * len(axes)
        if known and np.isclose(record.sampling_time, first.sampling_time):
            taps = [floor.whitening for floor in known]
        settling = settling_samples(record.widest, settings.settling_s)
        parts = [
            FitData(
                record.name, Motion.from_record(single, offset=rest), single["output"], whitening, settling
            )
            for single, whitening, rest in zip(map(record.axis, axes), taps, rests, strict=True)
        ]
        return SpatialData.join(parts, axes=axes)

    fitted, tests = list(map(data, chosen)), list(map(data, others))
    floor = NoiseFloor.together(known) if known else None
    fields = {"records": tuple(records), "faults": tuple(faults), "settling_s": settings.settling_s}
    return assemble_experiment(first.widest, fitted, tests, floor, rest=tuple(rests), **fields)


def axis_record(record: Record, axis: str) -> Record:
    """Return the record of one axis, with the axis in its name."""
    return replace(record.axis(axis), name=f"{record.name} ({axis})")


def axis_floors(record: Record) -> list[NoiseFloor] | list[None]:
    """Return the noise floor of every axis of a record; None for all axes if its motion does not repeat."""
    period = record.period or find_period(record) or find_period(record, MIN_FULL_PERIODS - 1)
    # The noise of an axis at rest does not repeat; it is estimated with the motion of another axis.
    moving = record.widest["input"]
    single = [
        record.axis(axis) if axis in record.moving else record.axis(axis).with_values(input=moving)
        for axis in record.axes
    ]
    floors = [noise_floor(item, period) for item in single if period]
    known = [floor for floor in floors if floor is not None]
    return known if len(known) == len(record.axes) else [None] * len(record.axes)
