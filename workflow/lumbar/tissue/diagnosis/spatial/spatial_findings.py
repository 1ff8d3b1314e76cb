"""Findings of records of several axes: mounting of the force sensor, exchanged channels, directions with little motion."""

from itertools import permutations, product

import numpy as np

from lumbar.base.formats import percent
from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.diagnosis.linear.direction import columns_yaml
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.selection.alternatives import position_offset
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, DiagnosisState, Status
from lumbar.tissue.diagnosis.selection.sentences import (
    distinguishing_digits,
    effects_text,
    error_falls,
    headline,
)
from lumbar.tissue.diagnosis.spatial.location_in_space import upward, vector_text
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.space import matrices_of, symmetric_base
from lumbar.tissue.models.structure import Structure

_MAX_RELATIVE_UNCERTAINTY = 0.2
"""Relative half width of the 95 % interval of a stiffness above which its direction is reported at a larger spread."""
_MIN_SPREAD, _MIN_SPREAD_IF_UNCERTAIN = 0.05, 0.25
"""Spreads of the position along a direction, relative to the largest spread, below which the direction is reported."""
SENSOR = ("turned_frame", "crosstalk")
"""Effects of the force sensor."""
_SENSOR_TEXTS = {"turned_frame": "rotated axes", "crosstalk": "crosstalk between its channels"}
_SELECTED_STATUSES = (Status.NAMED, Status.TIED)
"""Statuses with selected effects."""
_MAX_ERROR_RATIO, _MIN_GAIN = 0.5, 0.03
"""Largest ratio of the errors with a reported assignment of the channels and with the recorded assignment; and the smallest
additional share of the force's power that the reported assignment explains."""
_SYMMETRY_TOLERANCE = 0.1
"""Largest share of the force's power by which a reported assignment is worse than a general linear relation (rotated sensor)."""


def headline_in_space(result: DiagnosisResult) -> str:
    """Return the result in one sentence; effects of the force sensor and of the tissue are reported separately."""
    sensor = [_SENSOR_TEXTS[name] for name in result.selected if name in SENSOR]
    if not sensor or result.status not in _SELECTED_STATUSES:
        return headline(result)
    tissue = [name for name in result.selected if name not in SENSOR]
    base, fall = result.base.fit.structure.base.name, error_falls(result)
    start = f"is missing {effects_text(tissue)}" if tissue else "explains the tissue"
    added = "both" if tissue else "this"
    tied = ", ".join(effects_text(item.effects) for item in result.tied_with)
    end = f" These records do not distinguish it from {tied}." if tied else ""
    return f"The {base} model {start}, and the force sensor has {' and '.join(sensor)}: with {added} {fall}.{end}"


def report_mounting(state: DiagnosisState) -> DiagnosisState:
    """Report how the force sensor is mounted, and directions that the training record hardly excites."""
    result, experiment, fit = state.result, state.result.experiment, state.result.model.fit
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    selected, sensor = result.selected if result.status in _SELECTED_STATUSES else (), []
    if "turned_frame" in selected:
        rotation = [item for item in known if item.effect == "turned_frame"]
        sensor.append(_report_rotation(rotation, experiment.records[0].axes))
    if "crosstalk" in selected:
        sensor.append(_report_crosstalk([item for item in known if item.effect == "crosstalk"]))
    findings = [*position_offset(experiment), *sensor, *_report_unexcited_direction(experiment)]
    return state.report("report mounting and excitation", findings, "nothing to report")


def _report_rotation(known: list, axes: tuple[str, ...]) -> Finding:
    """Report the rotation of the force sensor in degrees, and the key of the study that corrects it."""
    vector = np.degrees([item.value for item in known])
    half = np.degrees([(item.high - item.low) / 2 for item in known])
    angle = float(np.linalg.norm(vector))
    spread = float(np.sqrt(np.sum((vector * half) ** 2)) / angle)
    # The study gives the rotation from the sensor's axes to those of the position, which is the opposite one.
    rotation = np.zeros(3)
    if len(axes) == 3:
        rotation[:] = -vector
    else:
        normal = next(number for number, axis in enumerate("xyz") if axis not in axes)
        rotation[normal] = (1.0 if axes == ("x", "z") else -1.0) * vector[0]
    low, value, high = distinguishing_digits([angle - spread, angle, angle + spread], 3)
    sentence = (
        f"The force sensor's axes are rotated by {value}° ({low} to {high}) from those of the position: declare tissue: "
        f"force_frame: [{', '.join(f'{part:.4g}' for part in rotation)}] and diagnose again. Crosstalk between the channels, "
        "with a tissue of other symmetry, looks the same."
    )
    return Finding("turned_frame", sentence, angle, "°")


def _report_crosstalk(known: list) -> Finding:
    """Report the shares of other axes' forces in the channels that are significantly not 0."""
    significant = [item for item in known if item.low > 0 or item.high < 0]
    shares = "; ".join(
        f"{item.name[len('share_of_') :].replace('_in_', ' in ')} {percent(item.value)} "
        f"({percent(item.low)} to {percent(item.high)})"
        for item in sorted(significant, key=lambda item: -abs(item.value))
    )
    largest = max((abs(item.value) for item in known), default=0.0)
    sentence = (
        "Channels of the force sensor read shares of the forces along other axes: "
        f"{shares or 'none is significant by itself'}. Calibrate the sensor; rotated axes of the sensor, with a tissue of other "
        "symmetry, look the same."
    )
    return Finding("crosstalk", sentence, 100 * largest, "%")


def _report_unexcited_direction(experiment: Experiment) -> list[Finding]:
    """Report the direction with the smallest motion of the training record, if its stiffness is uncertain.

    The stiffness is that of general symmetric matrices, which are independent of other directions.
    """
    training, axes = experiment.training, experiment.records[0].axes
    size = len(axes)
    fit = fit_base(Structure(symmetric_base(BASES["KV"], axes)), training)
    position = np.concatenate([item.motion.position.reshape(size, -1) for item in training.records], axis=1)
    variances, directions = np.linalg.eigh(np.cov(position))
    direction, share = upward(directions[:, 0]), float(np.sqrt(max(variances[0], 0.0) / variances[-1]))
    # Stiffness along the direction, and half of its 95 % interval.
    rows, columns = np.triu_indices(size)
    weight = direction[rows] * direction[columns] * np.where(rows == columns, 1.0, 2.0)
    count = len(weight)
    scaled, scale = scaled_covariance(fit, training)
    covariance = scaled[:count, :count] / np.outer(scale[:count], scale[:count])
    value = float(direction @ matrices_of(fit.linear[:count], 1, size)[0] @ direction)
    half = 1.96 * float(np.sqrt(weight @ covariance @ weight))
    certain = half < _MAX_RELATIVE_UNCERTAINTY * abs(value)
    if share > (_MIN_SPREAD if certain else _MIN_SPREAD_IF_UNCERTAIN):
        return []
    unit = f"{experiment.output_unit}/{experiment.input_unit}"
    sentence = (
        f"{training.name} hardly moves along {vector_text(direction)}: {percent(share)} of its motion along its main "
        f"direction. Without the information of other directions, the stiffness there is {value:.2g} {unit} "
        f"({value - half:.2g} to {value + half:.2g}); these records do not show whether effects are the same there."
    )
    return [Finding("unexcited", sentence, value, unit, training.name)]


def exchanged_channels(experiment: Experiment, layout: ColumnLayout | None) -> Finding | None:
    """Report which channels of the force are exchanged or inverted, if that is significant.

    The sentence ends with the lines to put into the study's YAML, in the column `layout` of the records.
    """
    # Sums of products over all samples, about the mean of each record: of the force, and of position and speed.
    axes = experiment.records[0].axes
    size = len(axes)
    power, along, moved = 0.0, np.zeros((size, 2 * size)), np.zeros((2 * size, 2 * size))
    for record in (*experiment.training.records, *experiment.tests):
        signals = (record.motion.position, record.force)
        position, force = (record.drop_history(item).reshape(size, -1) for item in signals)
        speed = np.stack([steady_velocity(each, record.motion.sampling_time) for each in position])
        motion = np.concatenate([position, speed])
        force, motion = (item - item.mean(axis=1, keepdims=True) for item in (force, motion))
        power += float(np.sum(force**2))
        along += force @ motion.T
        moved += motion @ motion.T
    # Channel and sign of every axis in all combinations, as recorded first.
    readings = (
        tuple(zip(order, signs, strict=True))
        for order in permutations(range(size))
        for signs in product((1, -1), repeat=size)
    )
    left = {}
    for reading in readings:
        read = np.stack([sign * along[source] for source, sign in reading])
        left[reading] = _unexplained_power(power, read, moved)
    recorded_power = next(iter(left.values()))
    best = min(left, key=lambda reading: left[reading])
    least = power - float(np.trace(along @ np.linalg.lstsq(moved, along.T, rcond=None)[0]))
    gain = recorded_power - left[best]
    better = left[best] <= _MAX_ERROR_RATIO * recorded_power and gain >= _MIN_GAIN * power
    if not better or left[best] > least + _SYMMETRY_TOLERANCE * power:
        return None
    force, explained = experiment.output_quantity, 1 - left[best] / power
    reading = ", ".join(
        f"along {axis} it is {'−' * (sign < 0)}{axes[source]}"
        for axis, (source, sign) in zip(axes, best, strict=True)
        if (axes[source], sign) != (axis, 1)
    )
    columns = {f"input_{axis}": _column("input", axis, experiment, layout) for axis in axes}
    for axis, (source, sign) in zip(axes, best, strict=True):
        column = _column("output", axes[source], experiment, layout)
        columns[f"output_{axis}"] = column if sign > 0 else column.other_sign
    sentence = (
        f"The channels of the {force} do not seem to be those of the position's axes: {reading} of the file. With this "
        f"assignment, a spring and a dashpot explain {percent(explained)} of the {force}, as recorded "
        f"{percent(1 - recorded_power / power)}: the stiffness and the viscosity of a tissue at rest are symmetric and "
        "never negative. No effect was searched; if this assignment is right, put this into the study's YAML:\n"
        f"{columns_yaml(**columns)}"
    )
    return Finding("force_channels", sentence, 100 * explained, "%")


def _unexplained_power(power: float, along: np.ndarray, moved: np.ndarray) -> float:
    """Return the power of a force that a passive spring and dashpot do not explain.

    The fit is least squares over symmetric matrices, with negative principal values set to 0. `along` has the sums of products of
    the force with position and speed, shape (axes, 2 × axes); `moved` those of position and speed, (2 × axes, 2 × axes).
    """
    size = len(along)
    rows, columns = np.triu_indices(size)
    terms = np.zeros((2 * len(rows), size, 2 * size))
    for part in range(2):
        for number, (row, column) in enumerate(zip(rows, columns, strict=True)):
            term = terms[part * len(rows) + number]
            term[row, part * size + column] = term[column, part * size + row] = 1.0
    normal = np.einsum("aij,jk,bik->ab", terms, moved, terms)
    solution = np.linalg.lstsq(normal, np.einsum("aij,ij->a", terms, along), rcond=None)[0]
    matrices = []
    for matrix in np.split(np.tensordot(solution, terms, axes=1), 2, axis=1):
        values, vectors = np.linalg.eigh(matrix)
        matrices.append((vectors * np.maximum(values, 0.0)) @ vectors.T)
    passive = np.concatenate(matrices, axis=1)
    return float(power - 2 * np.sum(passive * along) + np.sum((passive @ moved) * passive))


def _column(side: str, axis: str, experiment: Experiment, layout: ColumnLayout | None) -> ColumnSettings:
    """Return the column of the position (``input``) or force (``output``) along an axis; default the project's layout."""
    if layout is not None and layout.axes and f"{side}_{axis}" in layout.columns:
        return layout.columns[f"{side}_{axis}"]
    quantity, unit = getattr(experiment, f"{side}_quantity"), getattr(experiment, f"{side}_unit")
    return ColumnSettings(column=f"{quantity}_{axis}_{unit}", unit=unit, quantity=quantity)
