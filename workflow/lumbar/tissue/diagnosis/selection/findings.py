"""What a diagnosis finds beside missing effects: zeros of the sensors, linear dynamics of higher order."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import zero_interval
from lumbar.tissue.diagnosis.linear.linear_dynamics import linear_dynamics
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, unseen_improvement
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_NOTABLE = 0.01
"""Share of the response's range from which on a sensor's zero is worth a word."""


def offsets(found: Verdict) -> list[Finding]:
    """What the zeros of the sensors are, where they are worth a word."""
    experiment, fit = found.experiment, found.model.fit
    unit, quantity = experiment.output_unit, experiment.output_quantity
    findings = []
    if fit.structure.base.contact:
        findings.append(
            Finding(
                "surface",
                f"The tool is not fastened to the tissue: it meets the surface at {experiment.surface:.4g} "
                f"{experiment.input_unit}; depths are counted from there.",
                experiment.surface,
                experiment.input_unit,
            )
        )
    low, high = zero_interval(fit, experiment.training)
    notable = _NOTABLE * float(np.ptp(experiment.training.force))
    if abs(fit.zero) > notable and (low > 0 or high < 0):
        findings.append(
            Finding(
                "force_offset",
                f"The zero of the {quantity} lies at {fit.zero:+.3g} {unit} (95 % interval {low:.3g} to {high:.3g}), or that of "
                f"the {experiment.input_quantity} aside by as much as causes it; it was fitted with the model and "
                "taken off.",
                fit.zero,
                unit,
                experiment.training.name,
            )
        )
    if experiment.own_zeros and fit.structure.base.sensor_zero:
        findings += _own_zeros(fit, experiment)
    return findings


def _own_zeros(fit: Fit, experiment: Experiment) -> list[Finding]:
    unit, quantity = experiment.output_unit, experiment.output_quantity
    found = []
    for item in experiment.tests:
        zero = fit.zero - float(np.mean(item.trim(fit.simulate(item.motion) - item.force)))
        found.append(
            Finding(
                "force_offset",
                f"{item.name}: the zero of the {quantity} lies at {zero:+.3g} {unit}, in {experiment.training.name} at "
                f"{fit.zero:+.3g} {unit}: it moved between the records; each was judged from its own.",
                zero,
                unit,
                item.name,
            )
        )
    return found


def linear_alternative(model: Candidate, experiment: Experiment) -> tuple[Candidate, Finding] | None:
    """Linear model of higher order that explains all records surely better than a selected one, and what it reaches.

    By likelihood and number of parameters, and by the loss on unseen records. None where there is none; contact that is lost is
    never linear.
    """
    if model.fit.structure.base.contact:
        return None
    linear = evaluate(linear_dynamics(experiment), experiment)
    if unseen_improvement(model, linear, experiment) <= UNSEEN or linear.score >= model.score - TIED:
        return None
    unit, order = experiment.output_unit, linear.fit.order
    words = {
        "prony": "a spectrum of relaxation times",
        "rational": f"{order} poles",
        "delayed": f"{order} poles behind a delay",
    }[linear.fit.kind]
    finding = Finding(
        "higher_order_linear",
        f"Linear dynamics of higher order ({words}) explain these records better than any effect that is nonlinear: their "
        f"error on unseen records is {linear.test_rms:.3g} {unit}, that of the refined model {model.test_rms:.3g} {unit}.",
        float(order),
        "1",
    )
    return linear, finding
