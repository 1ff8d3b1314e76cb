"""Comparison of a model with records of several axes: by axis, with the noise of the axis, and in space."""

from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.noise.periods import fold_periods
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, residual_of, residual_reports
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, View
from lumbar.tissue.diagnosis.spatial.location_in_space import (
    SpatialResidual,
    direction_view,
    error_direction_view,
    travel_view,
    work_view,
)
from lumbar.tissue.diagnosis.spatial.spatial_data import axis_floors, axis_record
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.space import Symmetry
from lumbar.tissue.models.structure import Structure


@dataclass(frozen=True, eq=False)
class SpatialReport:
    """Comparison of a record of several axes with a model's free run."""

    record: Record
    values: np.ndarray
    """Free run, shape (axes, samples)."""
    axes: list[ResidualReport]
    """Reports of the axes with motion; the name of a report's record contains the axis."""
    residual: SpatialResidual
    views: dict[str, View]
    """Views in space, by name."""

    @property
    def headline(self) -> str:
        """The main result in one sentence; errors are per axis: root mean squares over all axes."""
        axes, record, unit = len(self.record.axes), self.record.name, self.residual.unit
        rms, explainable = np.sqrt([self.residual.variance / axes, self.residual.explainable / axes])
        floor = np.sqrt(np.trace(self.residual.noise) / axes)
        if self.is_noise:
            return f"{record}: no view in space shows more than noise would."
        if self.residual.is_near_noise_floor:
            return (
                f"{record}: the error in space is nearly all noise, {rms:.3g} {unit} per axis with a floor of {floor:.3g} "
                f"{unit}; significant views describe the rest."
            )
        if floor:
            return (
                f"{record}: {explainable:.3g} {unit} of the error's {rms:.3g} {unit} per axis are not noise."
            )
        return f"{record}: the error in space is {rms:.3g} {unit} per axis; its share of noise is unknown."

    @property
    def is_noise(self) -> bool:
        """True if no view in space shows more than noise, corrected for the number of views."""
        return min(view.p_value for view in self.views.values()) * len(self.views) >= SIGNIFICANT

    @property
    def sentences(self) -> list[str]:
        """Sentences of the views in space."""
        return [self.headline, *(view.sentence for view in self.views.values()), *self.remarks]

    @property
    def resting(self) -> list[str]:
        """Axes without motion, which are not compared."""
        compared = {item.record.name for item in self.axes}
        return [axis for axis in self.record.axes if axis_record(self.record, axis).name not in compared]

    @property
    def remarks(self) -> list[str]:
        """Sentence that lists the axes without motion; empty if all axes move."""
        axes = " and ".join(self.resting)
        return [f"{self.record.name}: along {axes} nothing moves, and nothing is compared."] if axes else []


def spatial_reports(model: FittedModel, experiment: Experiment, seed: int) -> list[SpatialReport]:
    """Simulate a model in space on the records of an experiment, compare it, and locate its errors.

    Parameters
    ----------
    model : FittedModel
        Model in space; work is reported along its principal axes if it has any.
    experiment : Experiment
        Prepared records of several axes.
    seed : int
        Random seed of the intervals.

    Raises
    ------
    InputError
        If the model has one axis.
    """
    records = experiment.records
    space = model.structure.base.spatial if isinstance(model.structure, Structure) else None
    if space is None:
        names = ", ".join(record.name for record in records)
        raise InputError(
            f"{model.name} is a model of one axis, but {names} has several. Use a model that refine or diagnose fitted to them."
        )
    frame = None
    if space.symmetry is not Symmetry.ISOTROPIC:  # a plane has its normal and the directions along it
        frame = np.reshape(space.frames[0], (len(space.axes), -1))
    axes = records[0].axes
    first = next(item for item in records if item.name == experiment.floor_from)
    floors = axis_floors(first)
    of_axis = [
        replace(experiment, floor=floor, floor_from=f"{first.name} ({axis})", rest=(rest,))
        for axis, floor, rest in zip(axes, floors, experiment.rest, strict=True)
    ]
    # Correlation of the noise of the axes, from the differences of successive periods.
    correlation = np.eye(len(axes))
    if floors[0] is not None:
        folding = fold_periods(first.widest, floors[0].period)
        changes = [np.diff(folding.fold(values), axis=0).ravel() for values in first.stacked("output")]
        covariance = np.cov(np.stack(changes))
        sizes = np.sqrt(np.diag(covariance))
        scaled = covariance / np.maximum(np.outer(sizes, sizes), 1e-300)
        correlation = np.where(np.eye(len(axes)), 1.0, scaled)
    runs = {}
    for record in records:
        force = model.simulate(record)
        single = [axis_record(record, axis) for axis in axes]
        runs[record.name] = record, force, list(zip(single, force, of_axis, strict=True))
    every = (run for *_, own in runs.values() for run in own)
    moving = [run for run in every if min(np.ptp(run[0][role]) for role in ("input", "output")) > 0]
    compared = {item.record.name: item for item in residual_reports(moving, seed)}
    reports = []
    for record, force, own in runs.values():
        parts = tuple(residual_of(*run) for run in own)
        measured = record.stacked("output")[:, -len(parts[0].values) :]
        residual = SpatialResidual(axes, parts, measured, correlation)
        views = [travel_view(residual), direction_view(residual), error_direction_view(residual)]
        views.append(work_view(residual, frame))
        moved = [compared[single.name] for single, *_ in own if single.name in compared]
        reports.append(SpatialReport(record, force, moved, residual, {view.name: view for view in views}))
    return reports
