"""Findings of records of several axes: how the force sensor is mounted, exchanged channels, directions that hardly move."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.diagnosis.linear.direction import columns_yaml
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.selection.alternatives import position_offset
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, DiagnosisState, Status
from lumbar.tissue.diagnosis.selection.sentences import (
    distinguishing_digits,
    effects_text,
    error_falls,
    headline,
)
from lumbar.tissue.diagnosis.spatial.location_in_space import in_words, upward
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.space import matrices_of, symmetric_base
from lumbar.tissue.models.structure import Structure

_VAGUE = 0.2
"""Half width of the 95 % interval of a stiffness, as a share of it, above which its direction is reported."""
_SMALL, _SMALLISH = 0.05, 0.25
"""Largest spread of the position along a reported direction, and along one with a vague stiffness, relative to the largest."""
SENSOR = ("turned_frame", "crosstalk")
"""Effects of the force sensor."""


NAMED = (Status.NAMED, Status.TIED)
"""Verdicts by which an effect is there."""
_TOLD = {"turned_frame": "axes that are turned", "crosstalk": "crosstalk between its channels"}


def headline_in_space(result: DiagnosisResult) -> str:
    """Return the result in one sentence; effects of the force sensor are not the tissue's."""
    sensor = [_TOLD[name] for name in result.selected if name in SENSOR]
    if not sensor or result.status not in NAMED:
        return headline(result)
    tissue = [name for name in result.selected if name not in SENSOR]
    base, fall = result.base.fit.structure.base.name, error_falls(result)
    told = f"the force sensor has {' and '.join(sensor)}"
    missing = (
        f"The {base} model is missing {effects_text(tissue)}, and" if tissue else f"Beside the {base} model"
    )
    tied = ", ".join(effects_text(item.effects) for item in result.tied_with)
    beside = f" These records do not tell it from {tied}." if tied else ""
    return f"{missing} {told}: with {'both' if tissue else 'it'} {fall}.{beside}"


def spatial_findings(state: DiagnosisState, axes: tuple[str, ...]) -> list[Finding]:
    """Findings of the force sensor, and of directions that the training record hardly excites."""
    experiment, fit = state.result.experiment, state.result.model.fit
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    found = []
    named = state.result.selected if state.result.status in NAMED else ()
    if "turned_frame" in named:
        found.append(_turned([item for item in known if item.effect == "turned_frame"], axes))
    if "crosstalk" in named:
        found.append(_crosstalk([item for item in known if item.effect == "crosstalk"]))
    return [*position_offset(experiment), *found, *_vague(experiment, axes)]


def _turned(known: list, axes: tuple[str, ...]) -> Finding:
    """The rotation of the force sensor in degrees, with what a study says of it."""
    vector = np.degrees([item.value for item in known])
    half = np.degrees([(item.high - item.low) / 2 for item in known])
    angle = float(np.linalg.norm(vector))
    spread = float(np.sqrt(np.sum((vector * half) ** 2)) / angle)
    # In a study the rotation is from the sensor's axes to the position's, hence the opposite one.
    about = (
        range(3)
        if len(axes) == 3
        else [next(number for number, axis in enumerate("xyz") if axis not in axes)]
    )
    said = np.zeros(3)
    sign = -1.0 if len(axes) == 3 or axes != ("x", "z") else 1.0
    said[list(about)] = sign * vector
    low, found, high = distinguishing_digits([angle - spread, angle, angle + spread], 3)
    frame = ", ".join(f"{part:.4g}" for part in said)
    sentence = (
        f"The force sensor's axes are rotated by {found}° ({low} to {high}) from those of the position: declare tissue: "
        f"force_frame: [{frame}] and diagnose again. Channels that read a share of each other's forces, with a tissue of other "
        "symmetry, look the same."
    )
    return Finding("turned_frame", sentence, angle, "°")


def _crosstalk(known: list) -> Finding:
    """Report the shares of other axes' forces in the channels that are significantly not 0."""
    sure = [item for item in known if item.low > 0 or item.high < 0]
    shares = "; ".join(
        f"{item.name[len('share_of_') :].replace('_in_', ' in ')} {100 * item.value:.2g} % "
        f"({100 * item.low:.2g} to {100 * item.high:.2g})"
        for item in sorted(sure, key=lambda item: -abs(item.value))
    )
    largest = max((abs(item.value) for item in known), default=0.0)
    sentence = (
        "Channels of the force sensor read shares of the forces along other axes: "
        f"{shares or 'none is significant by itself'}. Calibrate the sensor; rotated axes of the sensor, with a tissue of other "
        "symmetry, look the same."
    )
    return Finding("crosstalk", sentence, 100 * largest, "%")


def _vague(experiment: Experiment, axes: tuple[str, ...]) -> list[Finding]:
    """Report the direction with the least certain stiffness in the training record, if it is hardly moved along.

    From a fit of any symmetric matrices, which takes nothing from other directions.
    """
    training, size = experiment.training, len(axes)
    fit = fit_base(Structure(symmetric_base(BASES["KV"], axes)), training)
    # Direction of the least spread of the position, and its share of the largest.
    position = np.concatenate([item.motion.position.reshape(size, -1) for item in training.records], axis=1)
    variances, directions = np.linalg.eigh(np.cov(position))
    direction, share = upward(directions[:, 0]), float(np.sqrt(max(variances[0], 0.0) / variances[-1]))
    # Stiffness along it and half of its 95 % interval.
    rows, columns = np.triu_indices(size)
    weight = direction[rows] * direction[columns] * np.where(rows == columns, 1.0, 2.0)
    scaled, scale = scaled_covariance(fit, training)
    own = slice(0, len(weight))
    covariance = scaled[own, own] / np.outer(scale[own], scale[own])
    value = float(direction @ matrices_of(fit.linear[own], 1, size)[0] @ direction)
    half = 1.96 * float(np.sqrt(weight @ covariance @ weight))
    if share > (_SMALL if half < _VAGUE * abs(value) else _SMALLISH):
        return []
    unit = f"{experiment.output_unit}/{experiment.input_unit}"
    sentence = (
        f"{training.name} hardly moves along {in_words(direction)}: {100 * share:.2g} % of its motion along its main direction. "
        f"Without what other directions show, the stiffness there is {value:.2g} {unit} ({value - half:.2g} to "
        f"{value + half:.2g}); these records do not show whether effects act alike there."
    )
    return [Finding("unexcited", sentence, value, unit, training.name)]


_BETTER, _MORE = 0.5, 0.03
"""Largest error of another reading relative to that as recorded if it is right, and the smallest additional share of the
force's power that it explains."""
_AS_WELL = 0.1
"""Share of the force's power by which the right reading may leave more than any linear relation: a sensor that is turned."""


def exchanged_channels(
    experiment: Experiment, axes: tuple[str, ...], layout: ColumnLayout | None
) -> Finding | None:
    """Report which channels of the force are exchanged or have the other sign, if that is significant.

    The sentence ends with the lines to put into the study's YAML, in the `layout` that the records were read with.
    """
    products = _products_of(experiment, len(axes))
    power, along = products.power, products.force
    least = power - float(np.trace(along @ np.linalg.lstsq(products.motion, along.T, rcond=None)[0]))
    # Channel and sign of every axis, in every way, as recorded first.
    readings = (
        tuple(zip(order, signs, strict=True))
        for order in permutations(range(len(axes)))
        for signs in product((1, -1), repeat=len(axes))
    )
    left = {reading: _left(reading, products) for reading in readings}
    as_recorded = next(iter(left.values()))
    best = min(left, key=lambda reading: left[reading])
    better = left[best] <= _BETTER * as_recorded and as_recorded - left[best] >= _MORE * power
    if not better or left[best] > least + _AS_WELL * power:
        return None
    columns = _columns(best, axes, experiment, layout)
    force, explained = experiment.output_quantity, 100 * (1 - left[best] / power)
    reading = ", ".join(
        f"along {axis} it is {'−' * (sign < 0)}{axes[source]}"
        for axis, (source, sign) in zip(axes, best, strict=True)
        if (axes[source], sign) != (axis, 1)
    )
    sentence = (
        f"The channels of the {force} do not seem to be those of the position's axes: {reading} of the file. Read like this, a "
        f"spring and a dashpot explain {explained:.3g} % of the {force}, as recorded {100 * (1 - as_recorded / power):.3g} %: "
        "the stiffness and the viscosity of a tissue at rest are symmetric and never negative. No effect was searched; if this "
        f"reading is right, put this into the study's YAML:\n{columns_yaml(**columns)}"
    )
    return Finding("force_channels", sentence, explained, "%")


@dataclass(frozen=True, eq=False)
class _Products:
    """Sums of products over all samples of all records, about their means."""

    power: float
    """Force times itself, over all axes."""
    force: np.ndarray
    """Force times position and speed, shape (axes, 2 × axes)."""
    motion: np.ndarray
    """Position and speed times themselves, shape (2 × axes, 2 × axes)."""


def _products_of(experiment: Experiment, size: int) -> _Products:
    """Sum the products over the records of an experiment."""
    power, along, moved = 0.0, np.zeros((size, 2 * size)), np.zeros((2 * size, 2 * size))
    for record in (*experiment.training.records, *experiment.tests):
        step = record.motion.sampling_time
        position, force = (
            record.drop_history(item).reshape(size, -1) for item in (record.motion.position, record.force)
        )
        speed = np.stack([steady_velocity(each, step) for each in position])
        signals = np.concatenate([position, speed])
        force, signals = (item - item.mean(axis=1, keepdims=True) for item in (force, signals))
        power += float(np.sum(force**2))
        along += force @ signals.T
        moved += signals @ signals.T
    return _Products(power, along, moved)


def _left(reading: tuple[tuple[int, int], ...], products: _Products) -> float:
    """Return the power of the forces, as they are read, that a passive spring and dashpot do not explain.

    By least squares over symmetric matrices, whose negative values are then left out.
    """
    size = len(reading)
    read = np.stack([sign * products.force[source] for source, sign in reading])
    rows, columns = np.triu_indices(size)
    terms = np.zeros((2 * len(rows), size, 2 * size))
    for part in range(2):
        for number, (row, column) in enumerate(zip(rows, columns, strict=True)):
            term = terms[part * len(rows) + number]
            term[row, part * size + column] = term[column, part * size + row] = 1.0
    normal = np.einsum("aij,jk,bik->ab", terms, products.motion, terms)
    found = np.linalg.lstsq(normal, np.einsum("aij,ij->a", terms, read), rcond=None)[0]
    matrices = np.tensordot(found, terms, axes=1)
    parts = []
    for each in np.split(matrices, 2, axis=1):
        values, vectors = np.linalg.eigh(each)
        parts.append((vectors * np.maximum(values, 0.0)) @ vectors.T)
    passive = np.concatenate(parts, axis=1)
    return float(products.power - 2 * np.sum(passive * read) + np.sum((passive @ products.motion) * passive))


def _columns(
    reading: tuple[tuple[int, int], ...],
    axes: tuple[str, ...],
    experiment: Experiment,
    layout: ColumnLayout | None,
) -> dict[str, ColumnSettings]:
    """Columns of position and force as they should be read, by role."""
    known = layout.columns if layout is not None and layout.axes else {}
    kinds = {
        "input": (experiment.input_quantity, experiment.input_unit),
        "output": (experiment.output_quantity, experiment.output_unit),
    }

    def column(side: str, axis: str, sign: int = 1) -> ColumnSettings:
        quantity, unit = kinds[side]
        given = known.get(f"{side}_{axis}") or ColumnSettings(
            column=f"{quantity}_{axis}_{unit}", unit=unit, quantity=quantity
        )
        return given if sign > 0 else given.other_sign

    inputs = {f"input_{axis}": column("input", axis) for axis in axes}
    read = zip(axes, reading, strict=True)
    return inputs | {f"output_{axis}": column("output", axes[source], sign) for axis, (source, sign) in read}
