"""Comparison of a model with records of several axes: axis by axis, each with its noise, and in space."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.noise.periods import fold_periods
from lumbar.tissue.diagnosis.residuals.locate import ResidualReport, reports_of, residual_of
from lumbar.tissue.diagnosis.residuals.residual import SIGNIFICANT, View
from lumbar.tissue.diagnosis.spatial.location_in_space import SpatialResidual, views_in_space
from lumbar.tissue.diagnosis.spatial.spatial_data import axis_floors, axis_record
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.space import Symmetry
from lumbar.tissue.models.structure import Structure


@dataclass(frozen=True, eq=False)
class SpatialReport:
    """Comparison of a record of several axes with a model's free run."""

    record: Record
    values: np.ndarray
    """Shape (axes, samples): free run."""
    axes: list[ResidualReport]
    """Along every axis that does not rest; the record's name has the axis behind it."""
    residual: SpatialResidual
    views: dict[str, View]
    """In space."""

    @property
    def headline(self) -> str:
        """The main finding in one sentence; errors are those of an axis, root mean square over all of them."""
        axes, record, unit = len(self.record.axes), self.record.name, self.residual.unit
        rms, explainable = np.sqrt([self.residual.variance / axes, self.residual.explainable / axes])
        floor = np.sqrt(np.trace(self.residual.noise) / axes)
        if self.is_noise:
            return f"{record}: no view in space shows more than noise would."
        if self.residual.is_all_but_noise:
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
        """Whether no view in space shows more than noise, corrected for the number of views."""
        return min(view.p_value for view in self.views.values()) * len(self.views) >= SIGNIFICANT

    @property
    def sentences(self) -> list[str]:
        """Sentences of the views in space."""
        return [self.headline, *(view.sentence for view in self.views.values()), *self.remarks]

    @property
    def resting(self) -> list[str]:
        """Axes along which nothing moves and nothing is compared."""
        compared = {item.record.name for item in self.axes}
        return [axis for axis in self.record.axes if axis_record(self.record, axis).name not in compared]

    @property
    def remarks(self) -> list[str]:
        """The resting axes in one sentence."""
        axes = " and ".join(self.resting)
        return [f"{self.record.name}: along {axes} nothing moves, and nothing is compared."] if axes else []


def spatial_reports(model: FittedModel, experiment: Experiment, seed: int) -> list[SpatialReport]:
    """Simulate a model in space on the records of an experiment, compare it, and see where it fails.

    Work is reported along the model's principal axes, if it has some; `seed` is that of the intervals.

    Raises
    ------
    InputError
        If the model is one of one axis.
    """
    space = model.structure.base.spatial if isinstance(model.structure, Structure) else None
    if space is None:
        names = ", ".join(record.name for record in experiment.records)
        raise InputError(
            f"{model.name} is a model of one axis, {names} of several: give one that refine or diagnose fitted to them"
        )
    frame = None
    if space.symmetry is not Symmetry.ISOTROPIC:
        frame = np.reshape(
            space.frames[0], (len(space.axes), -1)
        )  # of a plane its normal and what is along it
    records = experiment.records
    axes = records[0].axes
    first = next(item for item in records if item.name == experiment.floor_from)
    floors = axis_floors(first)
    alone = [
        replace(experiment, floor=floor, floor_from=f"{first.name} ({axis})", rest=(rest,))
        for axis, floor, rest in zip(axes, floors, experiment.rest, strict=True)
    ]
    forces = [model.simulate(record) for record in records]
    simulated = [
        [(axis_record(record, axis), *rest) for axis, *rest in zip(axes, force, alone, strict=True)]
        for record, force in zip(records, forces, strict=True)
    ]
    correlation = _noise_correlation(first, floors)
    moved = [
        one for own in simulated for one in own if min(np.ptp(one[0]["input"]), np.ptp(one[0]["output"])) > 0
    ]
    found = {item.record.name: item for item in reports_of(moved, seed)}
    made = []
    for record, values, own in zip(records, forces, simulated, strict=True):
        parts = tuple(residual_of(*one) for one in own)
        reports = [found[one.name] for one, *_ in own if one.name in found]
        force = record.stacked("output")[:, -len(parts[0].values) :]
        residual = SpatialResidual(axes, parts, force, correlation)
        made.append(SpatialReport(record, values, reports, residual, views_in_space(residual, frame)))
    return made


def _noise_correlation(record: Record, floors: Sequence[NoiseFloor | None]) -> np.ndarray:
    """Correlation of the noise of a record's axes, from what differs between a period and the next."""
    if floors[0] is None:
        return np.eye(len(floors))
    folding = fold_periods(record.widest, floors[0].period)
    changes = np.stack([np.diff(folding.fold(values), axis=0).ravel() for values in record.stacked("output")])
    covariance = np.cov(changes)
    sizes = np.sqrt(np.diag(covariance))
    return np.where(np.eye(len(sizes)), 1.0, covariance / np.maximum(np.outer(sizes, sizes), 1e-300))
