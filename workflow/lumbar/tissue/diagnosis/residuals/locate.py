"""Where a model fails: five views of its error on every record, with the comparison of its free run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from lumbar.base.progress import track
from lumbar.records.record import Record
from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment, simulate_in_session
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.noise.periods import fold_periods
from lumbar.tissue.diagnosis.residuals.candidate_causes import (
    Cause,
    causes_sentence,
    causes_view,
    rank_causes,
)
from lumbar.tissue.diagnosis.residuals.compare import Comparison, compare_record, settling_samples
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import (
    motion_view,
    reversal_view,
)
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, Residual, View, percent, steady_velocity
from lumbar.tissue.diagnosis.residuals.time_frequency import frequency_view, time_view
from lumbar.tissue.identification.metrics import settling_time
from lumbar.tissue.models.measured_motion import for_base
from lumbar.tissue.models.motion import Motion

VIEWS = (time_view, frequency_view, motion_view, reversal_view, causes_view)
ALL_BUT_NOISE = 1.05
"""Ratio of error to noise floor below which the error hardly exceeds it."""


def locate(
    record: Record,
    simulated: np.ndarray,
    floor: NoiseFloor | None = None,
    floor_from: str = "",
    start: float = 0.0,
) -> Location:
    """See where a free-run simulation fails.

    `simulated` is a free run over the whole record, shape (samples,), of which the first `start` seconds do not count. `floor`
    is the noise of this record, or of another one with the same set-up, named by `floor_from`.

    Raises
    ------
    InputError
        If the simulation does not fit the record, is not finite, or nothing is left after the settling time.
    """
    residual = _residual(record, simulated, floor, floor_from, start)
    return _location(record, residual, rank_causes([residual]))


def _location(record: Record, residual: Residual, causes: Sequence[Cause]) -> Location:
    found = [view(residual) for view in VIEWS]
    return Location(record.name, residual, {view.name: view for view in found}, tuple(causes))


def residual_of(record: Record, simulated: np.ndarray, experiment: Experiment) -> Residual:
    """Return the residual of a simulation of a record after the settling time; raise as `locate` does."""
    start = settling_time(record, experiment.settling_s)
    noise = experiment.floor, experiment.floor_from
    return _residual(record, simulated, *noise, start, rest=experiment.rest[0])


def _residual(
    record: Record,
    simulated: np.ndarray,
    floor: NoiseFloor | None,
    floor_from: str,
    start: float,
    rest: float = 0.0,
) -> Residual:
    """Return the residual after `start` seconds, with positions counted from `rest`."""
    first = settling_samples(record, simulated, start)
    folding = None
    if floor is not None and floor_from in ("", record.name):
        # Periods that begin before the part that counts are left out.
        whole = fold_periods(record, floor.period)
        rows = whole.rows[whole.rows[:, 0] >= first] - first
        folding = replace(whole, rows=rows) if len(rows) >= 2 else None
    return Residual(
        values=(record["output"] - simulated)[first:],
        time=record.time[first:] - record.time[0],
        position=record["input"][first:] - rest,
        velocity=steady_velocity(record["input"], record.sampling_time)[first:],
        sampling_time=record.sampling_time,
        unit=record.channels["output"].unit,
        position_unit=record.channels["input"].unit,
        moved=record.channels["input"].quantity,
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
    """Causes of the error of all records together, by how well they are distinguished."""

    @property
    def shares(self) -> dict[str, float]:
        """Share of the explainable error by cause, in the order of `causes`, then the largest first.

        The spectrum has no part in it: all of a repeating error is in it.
        """
        motion, linear = self.views["position and velocity"], self.views["candidate causes"]
        found = {
            "time": self.views["time"].share,
            "position and velocity": motion.share,
            "depth": motion.numbers["depth_share"],
            "reversals": self.views["reversals"].share,
            "linear dynamics": linear.numbers["linear_share"],
        }
        order = {cause.name: place for place, cause in enumerate(self.causes)}
        return dict(sorted(found.items(), key=lambda item: (order.get(item[0], len(order)), -item[1])))

    @property
    def p_values(self) -> dict[str, float]:
        """Probability that noise alone shows as much, by view, and by cause within two of the views."""
        motion, linear = self.views["position and velocity"], self.views["candidate causes"]
        found = {view.name: view.p_value for view in self.views.values()}
        return found | {"depth": motion.numbers["depth_p"], "linear dynamics": linear.numbers["linear_p"]}

    @property
    def is_noise(self) -> bool:
        """True if no test shows more than noise would, with allowance for their number."""
        return min(self.p_values.values()) * len(self.p_values) >= SIGNIFICANT

    @property
    def is_all_but_noise(self) -> bool:
        """True if the error hardly exceeds the noise floor."""
        floor = self.residual.floor
        return floor is not None and self.residual.variance < (ALL_BUT_NOISE * floor.rms) ** 2

    @property
    def offset(self) -> float:
        """Mean error, in the output's unit."""
        return float(np.mean(self.residual.values))

    @property
    def offset_share(self) -> float:
        """Share of the explainable error that is a constant offset."""
        return self.residual.share(self.offset**2)

    @property
    def headline(self) -> str:
        """The main finding in one sentence."""
        residual, floor = self.residual, self.residual.floor
        unit, rms = residual.unit, np.sqrt(residual.variance)
        error = f"{self.record}: the error is {rms:.3g} {unit}"
        constant = f"a constant offset of {self.offset:+.3g} {unit} is {percent(self.offset_share)} of it"
        constant = f"; {constant}" if self.offset_share > 0.05 else ""
        if self.is_noise and floor is None:
            return f"{error}; no view distinguishes it from noise of the same spectrum{constant}."
        if self.is_noise:
            return f"{self.record}: no view shows more than noise would."
        if self.is_all_but_noise:
            return f"{error}, hardly more than the noise floor of {floor.rms:.3g} {unit}; significant views describe the rest."
        listed = [f"{name} ({percent(share)})" for name, share in self.shares.items() if share >= 0.005]
        seen = f"it is seen along {', '.join(listed[:3])}" if listed else "no view accounts for it"
        if floor is None:
            return f"{error}; {seen}{constant}; the views overlap."
        return (
            f"{self.record}: {np.sqrt(residual.explainable):.3g} {unit} of the error's {rms:.3g} {unit} are not noise; {seen}"
            f"{constant}; the views overlap."
        )

    @property
    def sentences(self) -> list[str]:
        """The location in plain English."""
        return [self.headline, *(view.sentence for view in self.views.values())]


def compare_and_locate(experiment: Experiment, fit: Fit, seed: int) -> list[ResidualReport]:
    """Simulate a fit on every record of an experiment, compare it, and see where it fails; `seed` is that of the intervals."""
    seen = [for_base(record, fit.structure.base) for record in experiment.records]
    simulate = simulation(seen, fit, experiment.surface, experiment.session)
    return residual_reports(seen, simulate, experiment, seed)


def simulation(
    records: Sequence[Record], fit: Fit, surface: float = 0.0, session: bool = False
) -> Callable[[Record], np.ndarray]:
    """A fit's free run as a function of the record; `records` as the fit's base asks for them, else as above."""

    def simulate(record: Record) -> np.ndarray:
        return fit.simulate(Motion.of(record, offset=surface))

    return simulate_in_session(records, simulate) if session else simulate


def residual_reports(
    records: Sequence[Record], simulate: Callable[[Record], np.ndarray], experiment: Experiment, seed: int
) -> list[ResidualReport]:
    """Simulate any model on records, compare it, and see where it fails.

    `simulate` goes from a record to the model's free run, shape (samples,). Noise and settling time are those of the
    `experiment`; `seed` is that of the intervals.
    """
    return reports_of([(record, simulate(record), experiment) for record in records], seed)


def reports_of(simulated: Sequence[tuple[Record, np.ndarray, Experiment]], seed: int) -> list[ResidualReport]:
    """Compare and locate free runs that were made, each with the experiment that its record belongs to; else as above."""
    residuals = [residual_of(*one) for one in simulated]
    causes, found = rank_causes(residuals), []
    for number, (record, values, experiment) in enumerate(track(simulated, "records compared and located")):
        start, floor = settling_time(record, experiment.settling_s), experiment.floor
        comparison = compare_record(record, values, floor, experiment.floor_from, start, seed + number)
        location = _location(record, residuals[number], causes)
        found.append(ResidualReport(record, values, comparison, location))
    return found


@dataclass(frozen=True, eq=False)
class ResidualReport:
    """A record with a model's free run, its comparison and the location of its error."""

    record: Record
    values: np.ndarray
    """Shape (samples,): free run."""
    comparison: Comparison
    location: Location
    remarks: ClassVar[tuple[str, ...]] = ()
    """Remarks on axes that rest: none, as a record of one axis moves along it."""

    @property
    def axes(self) -> list[ResidualReport]:
        """Reports along every axis: this one."""
        return [self]

    @property
    def views(self) -> dict[str, View]:
        """Views of the error by name."""
        return self.location.views

    @property
    def sentences(self) -> list[str]:
        """The location in plain English."""
        return self.location.sentences


def all_reports_sentence(reports: Sequence[Any]) -> str:
    """Name the cause of the error of all records together, as far as it is distinguished; of several axes, axis by axis."""
    locations = [item.location for item in of_axes(reports)]
    if all(item.is_noise or item.is_all_but_noise for item in locations):
        if any(item.residual.floor is None for item in locations):
            return "All records: no view distinguishes the error from noise of the same spectrum."
        return "All records: the error is noise, or hardly more than noise."
    axes = len(reports[0].record.axes)
    records = f"All {len(reports)} records" if len(reports) > 1 else "This record"
    records += f" of {axes} axes, axis by axis" if axes else ""
    return causes_sentence(locations[0].causes, records, locations[0].residual.error_name)


def of_axes(reports: Sequence[Any]) -> list[ResidualReport]:
    """Return the reports along every axis of records."""
    return [item for report in reports for item in report.axes]


def with_axes(reports: Sequence[Any]) -> list[Any]:
    """Reports of records, and of those of several axes one for every axis too."""
    return list(dict.fromkeys([*reports, *of_axes(reports)]))


def location_table(reports: Sequence[Any], source_label: str) -> Table:
    """Share, p-value and sentence of every view of every record, as ``location.csv`` publishes it."""
    rows = [
        {
            "record": item.record.name,
            "view": view.name,
            "share": view.share,
            "p_value": view.p_value,
            "finding": view.sentence,
        }
        for report in reports
        for item in with_axes([report])
        for view in item.views.values()
    ]
    return table_from_schema("tissue/diagnosis/residuals", "location", rows, source_label)
