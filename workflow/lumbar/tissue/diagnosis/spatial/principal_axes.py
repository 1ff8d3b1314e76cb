"""Principal stiffnesses and viscosities of a fitted tissue in space, with their axes and intervals."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import cycle

import numpy as np

from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits
from lumbar.tissue.diagnosis.spatial.location_in_space import upward, vector_text
from lumbar.tissue.models.parameter import AXES
from lumbar.tissue.models.space import PlaneContact

_ELLIPSE_QUANTILE = 2.4477
"""Radius in standard deviations that contains 95 % of a bivariate normal distribution (χ² with two degrees of freedom)."""
_DIRECTIONS = {"": "every direction", "_along": "axis", "_across": "across the axis"}
"""Direction of a principal value by the ending of its name; a value with another ending belongs to one of several axes."""


@dataclass(frozen=True)
class PrincipalAxis:
    """One principal value of a matrix, with its 95 % interval."""

    quantity: str
    """Parameter of the base of one axis, e.g. ``"spring_stiffness"``."""
    along: str
    """Name of the direction, e.g. ``"every direction"``, ``"axis"``, ``"across the axis"``, ``"axis 2"``."""
    value: float
    low: float | None
    high: float | None
    unit: str
    direction: tuple[float, ...] | None
    """Unit vector of the axis in the record's axes; None for a value of several directions."""
    cone_deg: float | None
    """Half angle of the cone that contains the axis with 95 % probability; None for axes that were not fitted."""


def principal_axes(fit: Fit, experiment: Experiment) -> list[PrincipalAxis]:
    """Return the principal values of every matrix of a fitted base; for a contact plane, the values normal to and along it."""
    spatial = fit.structure.base.spatial
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    nonlinear = fit.nonlinear[: len(spatial.nonlinear)]
    if isinstance(spatial, PlaneContact):
        normal = tuple(spatial.plane(nonlinear)[0].tolist())
        return [
            PrincipalAxis(item.name, along, item.value, item.low, item.high, item.unit, normal, None)
            for item, along in zip(known, ("into the surface", "friction along it"), strict=False)
        ]
    frames, cones, values = spatial.frames_at(nonlinear), _cones(fit, experiment), iter(known)
    rows = []
    for parameter, frame, cone in zip(spatial.base.linear, cycle(frames), cycle(cones or [()]), strict=False):
        for (ending, axes), item in zip(spatial.equal_axes.items(), values, strict=False):
            direction, cone_deg = None, None
            if len(axes) == 1:
                direction = tuple(upward(frame[:, axes[0]]).tolist())
                cone_deg = cone[axes[0]] if cone else None
            along = _DIRECTIONS.get(ending, f"axis {axes[0] + 1}")
            interval = (item.value, item.low, item.high, item.unit)
            rows.append(PrincipalAxis(parameter.name, along, *interval, direction, cone_deg))
    return rows


def _cones(fit: Fit, experiment: Experiment) -> list[list[float]]:
    """Return the half angle in degrees of the 95 % cone of every axis of every frame; empty for axes that were not fitted."""
    spatial = fit.structure.base.spatial
    if not (spatial.free and spatial.turns):
        return []
    scaled, size = scaled_covariance(fit, experiment.training)
    first = len(fit.linear) + len(spatial.base.nonlinear)
    cones, axes = [], len(spatial.axes)
    for number in range(len(spatial.frames)):
        angles = np.arange(first + number * spatial.turns, first + (number + 1) * spatial.turns)
        covariance = scaled[np.ix_(angles, angles)] / np.outer(size[angles], size[angles])
        if axes == 2:
            quantile, variances = 1.96, [float(covariance[0, 0])] * 2
        else:
            # An axis is moved by the rotations about the other two; a single axis only has these.
            whole = np.zeros((3, 3))
            whole[3 - len(angles) :, 3 - len(angles) :] = covariance
            others = [[second for second in range(3) if second != axis] for axis in range(3)]
            variances = [float(np.linalg.eigvalsh(whole[np.ix_(pair, pair)])[-1]) for pair in others]
            quantile = _ELLIPSE_QUANTILE
        cones.append([float(np.degrees(quantile * np.sqrt(max(variance, 0.0)))) for variance in variances])
    return cones


def axes_sentences(fit: Fit, experiment: Experiment) -> list[str]:
    """Report the symmetry and the principal values, one sentence per matrix."""
    spatial, rows = fit.structure.base.spatial, principal_axes(fit, experiment)
    if isinstance(spatial, PlaneContact):
        normal, depth = spatial.plane(fit.nonlinear[: len(spatial.nonlinear)])
        into, along = rows[:2]
        return [
            f"The tool is not fastened: it touches the tissue at a plane across {vector_text(normal)}, {depth:.3g} "
            f"{experiment.input_unit} along it; {_format_value(into)} {into.along}, coefficient of friction "
            f"{along.value / into.value:.3g}."
        ]
    sentences = []
    for item in spatial.base.linear:
        parts = []
        for row in (row for row in rows if row.quantity == item.name):
            along = f"in {row.along}" if row.along == "every direction" else row.along
            if row.direction is not None:
                cone = "" if row.cone_deg is None else f" ± {row.cone_deg:.2g}°"
                along = f"along {vector_text(row.direction)}{cone}"
            parts.append(f"{_format_value(row)} {along}")
        name = item.name.replace("_", " ").capitalize()
        sentences.append(f"{name} is {spatial.symmetry}: {'; '.join(parts)}.")
    return sentences


def _format_value(row: PrincipalAxis) -> str:
    assert row.low is not None and row.high is not None  # a fit has intervals
    low, value, high = distinguishing_digits([row.low, row.value, row.high], 3)
    return f"{value} {row.unit} ({low} to {high})"


def principal_axes_table(rows: Sequence[PrincipalAxis], axes: tuple[str, ...], source_label: str) -> Table:
    """Return the table ``principal_axes``."""
    frame = [
        {
            **asdict(row),
            **{f"direction_{axis}": None for axis in AXES},
            **{f"direction_{axis}": part for axis, part in zip(axes, row.direction or (), strict=False)},
        }
        for row in rows
    ]
    return table_from_schema("tissue/diagnosis/spatial", "principal_axes", frame, source_label)
