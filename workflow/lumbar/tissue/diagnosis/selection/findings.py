"""What a diagnosis finds beside missing effects: zeros of the sensors, linear dynamics of higher order."""

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import zero_interval
from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, is_adequate, unseen_improvement
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_START = 3
"""Samples that a record's beginning has at least."""
_BESIDE, _UNSURE = 0.1, 2.5
"""Distance between the zero at a record's beginning and over all of it, up to which it is one zero: a share of its shift, and
standard errors of the beginning's median."""
_NOTABLE = 0.01
"""Share of the response's range from which on a sensor's zero is worth a word."""


def offsets(found: Verdict) -> list[Finding]:
    """What the zeros of the sensors are, where they are worth a word."""
    experiment, fit = found.experiment, found.model.fit
    unit, quantity = experiment.output_unit, experiment.output_quantity
    findings = []
    if fit.structure.base.contact:
        findings.append(Finding.of("surface", experiment.surface, experiment.input_unit))
    else:
        findings += position_offset(experiment)
    low, high = zero_interval(fit, experiment.training)
    notable = _NOTABLE * float(np.ptp(experiment.training.force))
    if abs(fit.zero) > notable and (low > 0 or high < 0):
        words = {"force": quantity, "low": low, "high": high, "position": experiment.input_quantity}
        findings.append(Finding.of("force_offset", fit.zero, unit, experiment.training.name, **words))
    if experiment.own_zeros and fit.structure.base.sensor_zero:
        findings += _own_zeros(found)
    return findings


def position_offset(experiment: Experiment) -> list[Finding]:
    """From where positions are counted, where no record comes near 0."""
    if not any(experiment.rest):
        return []
    unit, size = experiment.input_unit, float(np.linalg.norm(experiment.rest))
    at = ", ".join(f"{value:.5g}" for value in experiment.rest)
    words = {"position": experiment.input_quantity, "at": f"({at})" if len(experiment.rest) > 1 else at}
    return [Finding.of("position_offset", size, unit, **words)]


@dataclass(frozen=True)
class _Zero:
    """The zero that an unseen record has under a model that was fitted to others."""

    name: str
    zero: float
    begins: float
    """Zero that the record's first samples have, before its motion tells."""
    first: int
    """Number of these."""
    rms: float
    """Error from its own zero, and from that of training."""
    strict_rms: float


def _zeros(found: Verdict) -> list[_Zero]:
    fit = found.model.fit
    zeros = []
    for item in found.experiment.tests:
        error = item.force - fit.simulate(item.motion)
        counted, start = item.trim(error), error[item.begins : max(item.first, item.begins + _START)]
        values = (fit.zero + float(value) for value in (counted.mean(), np.median(start)))
        sizes = float(counted.std()), float(np.sqrt(np.mean(counted**2)))
        zeros.append(_Zero(item.name, *values, len(start), *sizes))
    return zeros


def zeros_moved(found: Verdict) -> bool:
    """Whether records judged from zeros of their own begin with these, as far as noise allows, and not with that of training."""
    zeros, zero = _zeros(found), found.model.fit.zero
    away = np.array([item.begins - item.zero for item in zeros])
    shifts = np.array([item.zero - zero for item in zeros])
    noise = found.experiment.noise / np.sqrt([item.first for item in zeros])
    return bool(np.linalg.norm(away) < _BESIDE * np.linalg.norm(shifts) + _UNSURE * np.linalg.norm(noise))


def apparent_zeros(found: Verdict) -> Finding:
    """What zeros records would be given by a model that lacks something, and that they do not begin with them."""
    unit, zero = found.experiment.output_unit, found.model.fit.zero
    words = ", ".join(
        f"{item.name} {item.zero:+.3g} (begins at {item.begins:+.3g})" for item in _zeros(found)
    )
    training = found.experiment.training.name
    error = found.model.test_rms
    return Finding.of("apparent_zeros", zero, unit, error=error, zeros=words, training=training)


def _own_zeros(found: Verdict) -> list[Finding]:
    unit, quantity = found.experiment.output_unit, found.experiment.output_quantity
    training = found.experiment.training.name
    return [
        Finding(
            "force_offset",
            f"{item.name}: the zero of the {quantity} lies at {item.zero:+.3g} {unit}, in {training} at "
            f"{found.model.fit.zero:+.3g} {unit}: it moved between the records, and begins so; judged from its own, the error is "
            f"{item.rms:.3g} {unit}, from that of {training} {item.strict_rms:.3g}.",
            item.zero,
            unit,
            item.name,
        )
        for item in _zeros(found)
    ]


def linear_alternative(model: Candidate, experiment: Experiment) -> tuple[Candidate, Finding] | None:
    """Linear model of higher order that explains all records surely better than a selected one, and what it reaches.

    By likelihood and number of parameters, and by the loss on unseen records. None where there is none; contact that is lost is
    never linear, and what explains the records with as few states is not replaced by a model without names.
    """
    if model.fit.structure.base.contact:
        return None
    linear = evaluate(linear_dynamics(experiment), experiment)
    if unseen_improvement(model, linear, experiment) <= UNSEEN or linear.score >= model.score - TIED:
        return None
    unit, order = experiment.output_unit, linear.fit.order
    structure = model.fit.structure
    states = len(structure.base.state) + sum(len(form.state) for form in structure.forms)
    if is_adequate(model, experiment) and order <= states:
        return None
    words = {
        "prony": "a spectrum of relaxation times",
        "rational": f"{order} poles" if order else "of spring, dashpot and mass alone",
        "delayed": f"{order} poles behind a delay",
    }[linear.fit.kind]
    said = {"words": words, "error": linear.test_rms, "channel_unit": unit, "refined": model.test_rms}
    finding = Finding.of("higher_order_linear", float(order), "1", **said)
    return linear, finding
