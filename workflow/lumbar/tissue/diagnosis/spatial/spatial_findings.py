"""What records of several axes say beside missing effects: how the force sensor is mounted, where the tool hardly moves."""

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
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
"""Half width of the 95 % interval of a stiffness, as a share of it, from which on the direction is told."""
_SMALL, _SMALLISH = 0.05, 0.25
"""Share of the largest spread of the position up to which a direction is told, and one whose stiffness is vague."""
SENSOR = ("turned_frame", "crosstalk")
"""Effects of the force sensor."""


NAMED = (Status.NAMED, Status.TIED)
"""Verdicts by which an effect is there."""
_TOLD = {"turned_frame": "axes that are turned", "crosstalk": "crosstalk between its channels"}


def headline_in_space(result: DiagnosisResult) -> str:
    """The result in one sentence: what the force sensor does is none of the tissue's."""
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
    experiment, fit = state.experiment, state.model.fit
    known = estimates(fit, experiment.training, experiment.input_unit, experiment.output_unit)
    found = []
    named = state.selected if state.status in NAMED else ()
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
    # As a study says it: from the sensor's axes to the position's, hence the other way round.
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
    """Shares of other axes' forces that channels read, those that are surely not 0."""
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
    """The direction whose stiffness the training record tells least of, where that is little.

    From a fit of any symmetric matrices, which takes nothing from other directions.
    """
    fit = fit_base(Structure(symmetric_base(BASES["KV"], axes)), experiment.training)
    direction, share, value, half = _least_moved(fit, experiment, len(axes))
    if share > (_SMALL if half < _VAGUE * abs(value) else _SMALLISH):
        return []
    training, unit = experiment.training.name, f"{experiment.output_unit}/{experiment.input_unit}"
    sentence = (
        f"{training} hardly moves along {in_words(direction)}: {100 * share:.2g} % of its motion along its main direction. "
        f"Without what other directions show, the stiffness there is {value:.2g} {unit} ({value - half:.2g} to "
        f"{value + half:.2g}); these records do not show whether effects act alike there."
    )
    return [Finding("unexcited", sentence, value, unit, training)]


def _least_moved(fit: Fit, experiment: Experiment, size: int) -> tuple[np.ndarray, float, float, float]:
    """Direction that is moved in least, its share of the largest spread, its stiffness, and half of the 95 % interval."""
    records = experiment.training.records
    position = np.concatenate([item.motion.position.reshape(size, -1) for item in records], axis=1)
    variances, directions = np.linalg.eigh(np.cov(position))
    direction, share = upward(directions[:, 0]), float(np.sqrt(max(variances[0], 0.0) / variances[-1]))
    rows, columns = np.triu_indices(size)
    weight = direction[rows] * direction[columns] * np.where(rows == columns, 1.0, 2.0)
    scaled, scale = scaled_covariance(fit, experiment.training)
    own = slice(0, len(weight))
    covariance = scaled[own, own] / np.outer(scale[own], scale[own])
    matrix = matrices_of(fit.linear[own], 1, size)[0]
    half = 1.96 * float(np.sqrt(weight @ covariance @ weight))
    return direction, share, float(direction @ matrix @ direction), half
