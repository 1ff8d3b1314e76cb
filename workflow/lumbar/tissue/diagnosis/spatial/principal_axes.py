"""Principal stiffnesses and viscosities of a fitted tissue in space with their axes and intervals."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import cycle

import numpy as np

from lumbar.tables.table import Table, table_from_schema
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.diagnosis.selection.sentences import distinguishing_digits
from lumbar.tissue.diagnosis.spatial.location_in_space import in_words, upward
from lumbar.tissue.models.model_data import FittedParameter
from lumbar.tissue.models.parameter import AXES
from lumbar.tissue.models.space import PlaneContact, SpatialBase

_TWO_975 = 2.4477
"""Radius in standard deviations that holds 95 % of a plane's normal scatter (χ² of two degrees of freedom)."""


@dataclass(frozen=True)
class PrincipalAxis:
    """One principal value of one matrix."""

    quantity: str
    """Parameter of the base of one axis, e.g. ``"spring_stiffness"``."""
    along: str
    """E.g. ``"every direction"``, ``"axis"``, ``"across the axis"``, ``"axis 2"``."""
    value: float
    low: float
    high: float
    unit: str
    """`value`, `low`, `high`, `unit`: with the 95 % interval."""
    direction: tuple[float, ...] | None
    """Unit vector of the axis in the record's axes; None if there is none."""
    cone_deg: float | None
    """Half angle of the cone that holds the axis at 95 %; None without one or for frames that were not fitted."""


def principal_axes(fit: Fit, experiment: Experiment) -> list[PrincipalAxis]:
    """Principal values of every matrix of a fitted base; of one that meets a plane what acts into it."""
    spatial = fit.structure.base.spatial
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    own = fit.nonlinear[: len(spatial.nonlinear)]
    if isinstance(spatial, PlaneContact):
        words, normal = ("into the surface", "friction along it"), spatial.plane(own)[0]
        return [_value(item, item.name, along, normal) for item, along in zip(known, words, strict=False)]
    frames, cones, values = spatial.frames_at(own), _cones(fit, experiment), iter(known)
    found = []
    for item, frame, cone in zip(spatial.base.linear, cycle(frames), cycle(cones or [()]), strict=False):
        for (ending, axes), value in zip(spatial.alike.items(), values, strict=False):
            has_axis = len(axes) == 1
            along = _ALONG.get(ending, f"axis {axes[0] + 1}")
            direction = upward(frame[:, axes[0]]) if has_axis else None
            found.append(
                _value(value, item.name, along, direction, cone[axes[0]] if has_axis and cone else None)
            )
    return found


_ALONG = {"": "every direction", "_along": "axis", "_across": "across the axis"}
"""Meaning of a principal value by the ending of its name; all others belong to one of several axes."""


def _value(
    item: FittedParameter, quantity: str, along: str, direction: np.ndarray | None, cone: float | None = None
) -> PrincipalAxis:
    assert item.low is not None and item.high is not None  # a fit has intervals
    way = None if direction is None else tuple(direction.tolist())
    return PrincipalAxis(quantity, along, item.value, item.low, item.high, item.unit, way, cone)


def _cones(fit: Fit, experiment: Experiment) -> list[list[float]]:
    """Half angle in degrees of the 95 % cone of every axis of every frame; none where axes were not fitted."""
    spatial: SpatialBase = fit.structure.base.spatial
    if not (spatial.free and spatial.turns):
        return []
    scaled, size = scaled_covariance(fit, experiment.training)
    first = len(fit.linear) + len(spatial.base.nonlinear)
    found, axes = [], len(spatial.axes)
    for number in range(len(spatial.frames)):
        own = np.arange(first + number * spatial.turns, first + (number + 1) * spatial.turns)
        covariance = scaled[np.ix_(own, own)] / np.outer(size[own], size[own])
        if axes == 2:
            widest = [float(covariance[0, 0])] * 2
        else:
            # An axis is moved by the turns about the other two; one alone is turned about those only.
            whole = np.zeros((3, 3))
            whole[3 - len(own) :, 3 - len(own) :] = covariance
            others = [[second for second in range(3) if second != axis] for axis in range(3)]
            widest = [float(np.linalg.eigvalsh(whole[np.ix_(pair, pair)])[-1]) for pair in others]
        quantile = 1.96 if axes == 2 else _TWO_975
        found.append([float(np.degrees(quantile * np.sqrt(max(variance, 0.0)))) for variance in widest])
    return found


def axes_sentences(fit: Fit, experiment: Experiment) -> list[str]:
    """Report the symmetry and the principal values, one sentence per matrix."""
    spatial = fit.structure.base.spatial
    found = principal_axes(fit, experiment)
    if isinstance(spatial, PlaneContact):
        return [_plane_sentence(spatial, fit, found, experiment)]
    lines = []
    for item in spatial.base.linear:
        own = [row for row in found if row.quantity == item.name]
        told = "; ".join(_told(row) for row in own)
        lines.append(f"{item.name.replace('_', ' ').capitalize()} is {spatial.symmetry}: {told}.")
    return lines


def _plane_sentence(
    plane: PlaneContact, fit: Fit, rows: Sequence[PrincipalAxis], experiment: Experiment
) -> str:
    normal, depth = plane.plane(fit.nonlinear[: len(plane.nonlinear)])
    into, along = rows[:2]
    friction = f"coefficient of friction {along.value / into.value:.3g}"
    return (
        f"The tool is not fastened: it meets the tissue at a plane across {in_words(normal)}, {depth:.3g} "
        f"{experiment.input_unit} along it; {_told(replace(into, direction=None))}, {friction}."
    )


def _told(row: PrincipalAxis) -> str:
    low, found, high = distinguishing_digits([row.low, row.value, row.high], 3)
    value = f"{found} {row.unit} ({low} to {high})"
    if row.direction is None:
        return f"{value} in {row.along}" if row.along == "every direction" else f"{value} {row.along}"
    within = "" if row.cone_deg is None else f" ± {row.cone_deg:.2g}°"
    return f"{value} along {in_words(row.direction)}{within}"


def principal_axes_table(rows: Sequence[PrincipalAxis], axes: tuple[str, ...], source_label: str) -> Table:
    """The table ``principal_axes``."""
    written = [
        {
            **asdict(row),
            **{f"direction_{axis}": None for axis in AXES},
            **{f"direction_{axis}": part for axis, part in zip(axes, row.direction or (), strict=False)},
        }
        for row in rows
    ]
    return table_from_schema("tissue/diagnosis/spatial", "principal_axes", written, source_label)
