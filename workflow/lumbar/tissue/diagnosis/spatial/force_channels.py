"""Whether the channels of the force are those of the position's axes, each with its sign: by what no tissue at rest can do.

Stiffness and viscosity are symmetric matrices without negative values (a spring gives back what it took, whichever way it was
loaded; a dashpot only takes). A channel of the other sign, or two that are exchanged, leave matrices that are neither.
"""

from itertools import permutations, product

import numpy as np

from lumbar.settings.layout import ColumnLayout, ColumnSettings
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.direction import columns_yaml
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity

_BETTER, _MORE = 0.5, 0.03
"""What another reading leaves of the force, in what is left as recorded, up to which it is the right one; and the share of the
force's power that it must explain beside."""
_AS_WELL = 0.1
"""Share of the force's power by which the right reading may leave more than any linear relation: a sensor that is turned."""


def exchanged_channels(
    experiment: Experiment, axes: tuple[str, ...], layout: ColumnLayout | None
) -> Finding | None:
    """Say which channels of the force are exchanged or count the other way, where that is sure.

    The sentence ends with the lines to put into the study's YAML, in the `layout` that the records were read with.
    """
    power, along, moved = _products(experiment, len(axes))
    least = power - float(np.trace(along @ np.linalg.lstsq(moved, along.T, rcond=None)[0]))
    # Channel and sign of every axis, in every way, as recorded first.
    readings = (
        tuple(zip(order, signs, strict=True))
        for order in permutations(range(len(axes)))
        for signs in product((1, -1), repeat=len(axes))
    )
    left = {reading: _left(reading, power, along, moved) for reading in readings}
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


def _products(experiment: Experiment, size: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Power of the force, its products with position and speed, and those of these, over all records about their means."""
    power, along, moved = 0.0, np.zeros((size, 2 * size)), np.zeros((2 * size, 2 * size))
    for record in (*experiment.training.records, *experiment.tests):
        step = record.motion.sampling_time
        position, force = (
            record.own(item).reshape(size, -1) for item in (record.motion.position, record.force)
        )
        speed = np.stack([steady_velocity(each, step) for each in position])
        signals = np.concatenate([position, speed])
        force, signals = (item - item.mean(axis=1, keepdims=True) for item in (force, signals))
        power += float(np.sum(force**2))
        along += force @ signals.T
        moved += signals @ signals.T
    return power, along, moved


def _left(reading: tuple[tuple[int, int], ...], power: float, along: np.ndarray, moved: np.ndarray) -> float:
    """Power that a passive spring and dashpot leave of the forces as they are read.

    By least squares over symmetric matrices, whose negative values are then left out.
    """
    size = len(reading)
    read = np.stack([sign * along[source] for source, sign in reading])
    rows, columns = np.triu_indices(size)
    terms = np.zeros((2 * len(rows), size, 2 * size))
    for part in range(2):
        for number, (row, column) in enumerate(zip(rows, columns, strict=True)):
            term = terms[part * len(rows) + number]
            term[row, part * size + column] = term[column, part * size + row] = 1.0
    normal = np.einsum("aij,jk,bik->ab", terms, moved, terms)
    found = np.linalg.lstsq(normal, np.einsum("aij,ij->a", terms, read), rcond=None)[0]
    matrices = np.tensordot(found, terms, axes=1)
    parts = []
    for each in np.split(matrices, 2, axis=1):
        values, vectors = np.linalg.eigh(each)
        parts.append((vectors * np.maximum(values, 0.0)) @ vectors.T)
    passive = np.concatenate(parts, axis=1)
    return float(power - 2 * np.sum(passive * read) + np.sum((passive @ moved) * passive))


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
