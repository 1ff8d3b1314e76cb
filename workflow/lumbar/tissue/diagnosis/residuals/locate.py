"""Location of a model's error: views of the error on every record, with the comparison of the free run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from lumbar.base.progress import track
from lumbar.records.record import Record
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, excluded_time, simulate_in_session
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.noise.periods import fold_periods
from lumbar.tissue.diagnosis.residuals.candidate_causes import (
    Cause,
    causes_sentence,
    causes_view,
    rank_causes,
)
from lumbar.tissue.diagnosis.residuals.compare import Comparison, compare_record, settling_samples
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import motion_view, reversal_view
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual, View, percent, steady_velocity
from lumbar.tissue.diagnosis.residuals.time_frequency import band_view, line_view, time_view
from lumbar.tissue.models.measured_motion import for_base
from lumbar.tissue.models.motion import Motion

NEAR_FLOOR_RATIO = 1.05
"""Ratio of error to noise floor below which the error hardly exceeds it."""


def residual_of(record: Record, simulated: np.ndarray, experiment: Experiment) -> Residual:
    """Return the residual of a simulation of a record, shape (samples,), after the settling time.

    Raises
    ------
    InputError
        If the simulation does not fit the record, is not finite, or nothing is left after the settling time.
    """
    start = excluded_time(record, experiment.settling_s)
    noise = experiment.floor, experiment.floor_from
    return residual_after(record, simulated, *noise, start, rest=experiment.rest[0])


def residual_after(
    record: Record,
    simulated: np.ndarray,
    floor: NoiseFloor | None = None,
    floor_from: str = "",
    start: float = 0.0,
    rest: float = 0.0,
) -> Residual:
    """Return the residual after `start` seconds, with positions counted from `rest`; `floor_from` names the floor's record."""
    first = settling_samples(record, simulated, start)
    folding = None
    if floor is not None and floor_from in ("", record.name):
        # Periods that begin before the part that counts are left out.
        whole = fold_periods(record, floor.period)
        rows = whole.rows[whole.rows[:, 0] >= first] - first
        folding = replace(whole, rows=rows) if len(rows) >= 2 else None
    moved = record.channels["input"]
    return Residual(
        values=(record["output"] - simulated)[first:],
        time=record.time[first:] - record.time[0],
        position=record["input"][first:] - rest,
        velocity=steady_velocity(record["input"], record.sampling_time)[first:],
        sampling_time=record.sampling_time,
        unit=record.channels["output"].unit,
        position_unit=moved.unit,
        moved=moved.quantity,
        floor=floor,
        folding=folding,
    )


@dataclass(frozen=True, eq=False)
class Location:
    """All views of one record's error."""

    record: str
    residual: Residual
    views: dict[str, View]
    """Views by name, in the order of the report."""
    causes: tuple[Cause, ...]
    """Causes of the error of all records together, in the order of `rank_causes`."""

    @classmethod
    def from_residual(cls, record: str, residual: Residual, causes: Sequence[Cause]) -> Location:
        """Return all views of a record's residual; `causes` are the causes for all records."""
        spectrum_view = band_view if residual.folding is None else line_view
        kinds = (time_view, spectrum_view, motion_view, reversal_view, causes_view)
        views = [view(residual) for view in kinds]
        return cls(record, residual, {view.name: view for view in views}, tuple(causes))

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the explainable error: of `causes` in their order, then of other causes, the largest first."""
        motion, linear = self.views["position and velocity"], self.views["candidate causes"]
        shares = {
            "time": self.views["time"].share,
            "position and velocity": motion.share,
            "depth": motion.numbers["depth_share"],
            "reversals": self.views["reversals"].share,
            "linear dynamics": linear.numbers["linear_share"],
        }
        order = {cause.name: place for place, cause in enumerate(self.causes)}
        return dict(sorted(shares.items(), key=lambda item: (order.get(item[0], len(order)), -item[1])))

    @property
    def p_values(self) -> dict[str, float]:
        """Probability under noise only, by view, and by cause for two of the views."""
        motion, linear = self.views["position and velocity"], self.views["candidate causes"]
        by_view = {view.name: view.p_value for view in self.views.values()}
        return by_view | {"depth": motion.numbers["depth_p"], "linear dynamics": linear.numbers["linear_p"]}

    @property
    def is_noise(self) -> bool:
        """True if no test shows more than noise, with correction for the number of tests."""
        return min(self.p_values.values()) * len(self.p_values) >= SIGNIFICANT

    @property
    def is_near_noise_floor(self) -> bool:
        """True if the error hardly exceeds the noise floor."""
        floor = self.residual.floor
        return floor is not None and self.residual.variance < (NEAR_FLOOR_RATIO * floor.rms) ** 2

    @property
    def offset_share(self) -> float:
        """Share of the explainable error that is a constant offset."""
        return self.residual.share(float(np.mean(self.residual.values)) ** 2)

    @property
    def size(self) -> str:
        """Size of the error, and of its part that is not noise if the noise is known."""
        residual = self.residual
        unit, rms = residual.unit, np.sqrt(residual.variance)
        if residual.floor is None:
            return f"{self.record}: the error is {rms:.3g} {unit}"
        return f"{self.record}: {np.sqrt(residual.explainable):.3g} {unit} of the error's {rms:.3g} {unit} are not noise"

    @property
    def headline(self) -> str:
        """The main finding in one sentence."""
        residual, floor = self.residual, self.residual.floor
        unit, rms = residual.unit, np.sqrt(residual.variance)
        error = f"{self.record}: the error is {rms:.3g} {unit}"
        offset = np.mean(residual.values)
        constant = f"a constant offset of {offset:+.3g} {unit} is {percent(self.offset_share)} of it"
        constant = f"; {constant}" if self.offset_share > 0.05 else ""
        if self.is_noise and floor is None:
            return f"{error}; no view distinguishes it from noise of the same spectrum{constant}."
        if self.is_noise:
            return f"{self.record}: no view shows more than noise would."
        if self.is_near_noise_floor:
            return f"{error}, hardly more than the noise floor of {floor.rms:.3g} {unit}; significant views describe the rest."
        listed = [f"{name} ({percent(share)})" for name, share in self.shares.items() if share >= 0.005]
        along = f"it is seen along {', '.join(listed[:3])}" if listed else "no view accounts for it"
        return f"{self.size}; {along}{constant}; the views overlap."

    @property
    def sentences(self) -> list[str]:
        """The location in plain English."""
        return [self.headline, *(view.sentence for view in self.views.values())]


def compare_and_locate(experiment: Experiment, fit: Fit, seed: int) -> list[ResidualReport]:
    """Simulate a fit on every record, compare it and locate its error; `seed` is the random seed of the intervals."""
    records = [for_base(record, fit.structure.base) for record in experiment.records]
    simulate = simulation(records, fit, experiment.surface, experiment.session)
    return residual_reports([(record, simulate(record), experiment) for record in records], seed)


def simulation(
    records: Sequence[Record], fit: Fit, surface: float = 0.0, session: bool = False
) -> Callable[[Record], np.ndarray]:
    """Return the free run of a fit, shape (samples,), as a function of the record.

    The records have the channels that the fit's base requires. Positions are counted from `surface`, in the input's unit. In a
    session each record begins in the state at the end of the record before.
    """

    def simulate(record: Record) -> np.ndarray:
        return fit.simulate(Motion.from_record(record, offset=surface))

    return simulate_in_session(records, simulate) if session else simulate


def residual_reports(
    simulated: Sequence[tuple[Record, np.ndarray, Experiment]], seed: int
) -> list[ResidualReport]:
    """Compare free runs of any model with records, and locate the error of the model.

    Each record comes with its free run, shape (samples,), and the experiment that defines noise and settling time. `seed` is the
    random seed of the intervals.
    """
    residuals = [residual_of(*one) for one in simulated]
    causes, reports = rank_causes(residuals), []
    for number, (record, values, experiment) in enumerate(track(simulated, "records compared and located")):
        start, floor = excluded_time(record, experiment.settling_s), experiment.floor
        comparison = compare_record(record, values, floor, experiment.floor_from, start, seed + number)
        location = Location.from_residual(record.name, residuals[number], causes)
        reports.append(ResidualReport(record, values, comparison, location))
    return reports


@dataclass(frozen=True, eq=False)
class ResidualReport:
    """A record with a model's free run, its comparison and the location of its error."""

    record: Record
    values: np.ndarray
    """Free run of the model, shape (samples,)."""
    comparison: Comparison
    location: Location
    remarks: ClassVar[tuple[str, ...]] = ()
    """Remarks on axes without motion: none, because a record of one axis moves along this axis."""

    @property
    def axes(self) -> list[ResidualReport]:
        """Reports by axis; a record of one axis has only this report."""
        return [self]

    @property
    def views(self) -> dict[str, View]:
        """Views of the error, by name."""
        return self.location.views

    @property
    def sentences(self) -> list[str]:
        """The location in plain English."""
        return self.location.sentences


def all_reports_sentence(reports: Sequence[Any]) -> str:
    """Name the cause of the error of all records together, separately for every axis."""
    locations = [item.location for item in axis_reports(reports)]
    if not is_located(reports):
        if any(item.residual.floor is None for item in locations):
            return "All records: no view distinguishes the error from noise of the same spectrum."
        return "All records: the error is noise, or hardly more than noise."
    axes = len(reports[0].record.axes)
    records = f"All {len(reports)} records" if len(reports) > 1 else "This record"
    records += f" of {axes} axes, axis by axis" if axes else ""
    return causes_sentence(locations[0].causes, records, locations[0].residual.error_name)


def is_located(reports: Sequence[Any]) -> bool:
    """Return whether the error of any record is more than noise, so that its causes are meaningful."""
    locations = [item.location for item in axis_reports(reports)]
    return not all(item.is_noise or item.is_near_noise_floor for item in locations)


def axis_reports(reports: Sequence[Any]) -> list[ResidualReport]:
    """Return the reports of records for every axis."""
    return [item for report in reports for item in report.axes]


def expand_axes(reports: Sequence[Any]) -> list[Any]:
    """Return the reports of records and, for records of several axes, the reports of every axis."""
    return list(dict.fromkeys([*reports, *axis_reports(reports)]))


def location_table(reports: Sequence[Any], source_label: str) -> Table:
    """Return share, p-value and sentence of every view of every record, the content of ``location.csv``."""
    rows = [
        {
            "record": item.record.name,
            "view": view.name,
            "share": view.share,
            "p_value": view.p_value,
            "finding": view.sentence,
        }
        for report in reports
        for item in expand_axes([report])
        for view in item.views.values()
    ]
    return table_from_schema("tissue/diagnosis/residuals", "location", rows, source_label)
