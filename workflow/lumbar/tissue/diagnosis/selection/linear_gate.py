"""Whether linear dynamics of higher order explain what nonlinear effects seem to: they are asked first."""

from __future__ import annotations

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.linear.higher_order import linear_dynamics
from lumbar.tissue.diagnosis.selection.forward_selection import Candidate, evaluate, unseen_improvement
from lumbar.tissue.diagnosis.selection.thresholds import TIED, UNSEEN


def linear_alternative(model: Candidate, experiment: Experiment) -> Candidate | None:
    """Linear model of higher order that explains all records surely better than a selected one; None where there is none.

    By likelihood and number of parameters, and by the loss on unseen records. Contact that is lost is never linear.
    """
    if model.fit.structure.base.contact:
        return None
    linear = evaluate(linear_dynamics(experiment), experiment)
    surely = unseen_improvement(model, linear, experiment) > UNSEEN
    return linear if surely and linear.score < model.score - TIED else None


def linear_finding(linear: Candidate, model: Candidate, experiment: Experiment) -> Finding:
    """Say what linear dynamics reach."""
    unit, kind, order = experiment.output_unit, linear.fit.kind, linear.fit.order
    words = {
        "prony": "a spectrum of relaxation times",
        "rational": f"{order} poles",
        "delayed": f"{order} poles behind a delay",
    }[kind]
    return Finding(
        "higher_order_linear",
        f"Linear dynamics of higher order ({words}) explain these records better than any effect that is nonlinear: their "
        f"error on unseen records is {linear.test_rms:.3g} {unit}, that of the refined model {model.test_rms:.3g} {unit}.",
        float(order),
        "1",
    )
