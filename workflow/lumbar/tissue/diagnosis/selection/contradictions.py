"""Whether a fitted model contradicts itself: a name must agree with its own parameters, or it is not named."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit, shape_bounds
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates, scaled_covariance
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.model_data import FittedParameter
from lumbar.tissue.models.motion import Motion

_AT_BOUND = 1e-3
"""Distance from a bound, as a share of the logarithmic range, within which a parameter counts as at it."""


def contradictions(fit: Fit, experiment: Experiment) -> list[str]:
    """Say what in a fitted model contradicts the names of its effects.

    - No force that an effect adds is surely different from 0 (of several, or of those that its form calls essential, one
      of them or all together).
    - A parameter that decides whether the mechanism is there lies at the end of its range.
    - What the form itself refuses (`Form.contradiction`): a limit that the record exceeds, less than two cycles of a
      disturbance or a frequency of the excitation's own grid.
    - Nothing is left of the base.

    Parameters
    ----------
    fit : Fit
        Base and effects.

    Returns
    -------
    list of str
        One sentence each; empty where nothing contradicts.
    """
    structure, training = fit.structure, experiment.training
    count = len(structure.base.linear)
    found = []
    if count and structure.base.system == "tissue" and not np.any(fit.linear[:count] > 0):
        found.append(f"nothing is left of {structure.base.name}: all its stiffnesses are 0")
    known = estimates(fit, training, experiment.input_unit, experiment.output_unit)
    low, high = shape_bounds(structure, training, fit.nonlinear) if len(fit.nonlinear) else ((), ())
    position = len(structure.base.nonlinear)
    for form in structure.forms:
        own = [item for item in known if item.effect == form.effect]
        found += _nothing_added(form, own, fit, training)
        for shape in form.nonlinear:
            if shape.decisive and _at_end(fit.nonlinear[position], low[position], high[position]):
                found.append(f"{form.effect}: {shape.name} is at the end of its range")
            position += 1
        if form.contradiction is not None:
            values = {item.name: item.value for item in own}
            found += _refused(form, values, fit, experiment)
    return found


def _nothing_added(form: Form, own: list[FittedParameter], fit: Fit, training: FitData) -> list[str]:
    names = form.essential or tuple(item.name for item in form.linear)
    sizes = [item for item in own if item.name in names]
    if not sizes or any(item.low > 0 or item.high < 0 for item in sizes):
        return []
    if len(sizes) > 1 and _surely_together(form, names, fit, training):
        return []
    return [f"{form.effect}: the interval of {', '.join(names)} holds 0"]


def _surely_together(form: Form, names: tuple[str, ...], fit: Fit, training: FitData) -> bool:
    """Whether several amplitudes together are surely not 0, by Wald's test: alike ones hide each other's share."""
    from scipy.stats import chi2

    owners = [form for form in fit.structure.forms for _ in form.linear]
    items = fit.structure.linear[len(fit.structure.base.linear) :]
    mine = [index for index, item in enumerate(items) if owners[index] is form and item.name in names]
    chosen = np.array(mine) + len(fit.structure.base.linear)
    scaled, size = scaled_covariance(fit, training)
    amplitudes = fit.linear[chosen] * size[chosen]
    wald = amplitudes @ np.linalg.pinv(scaled[np.ix_(chosen, chosen)], rcond=1e-12) @ amplitudes
    return bool(wald > chi2.ppf(0.95, len(chosen)))


def _at_end(value: float, low: float, high: float) -> bool:
    room = _AT_BOUND * np.log(high / low)
    return bool(np.log(value / low) < room or np.log(high / value) < room)


def _refused(form: Form, values: dict[str, float], fit: Fit, experiment: Experiment) -> list[str]:
    """What a form itself says of its parameters on the training records, one by one."""
    training = experiment.training
    noise = experiment.floor.rms if experiment.floor else fit.rms(training)
    motions = (training.motion,) if isinstance(training.motion, Motion) else training.motion.parts
    forces = [training.force] if len(motions) == 1 else training.motion.split(training.force)
    period = experiment.floor.period if experiment.floor else None
    for motion, force in zip(motions, forces, strict=True):
        words = form.contradiction(values, motion, force - fit.zero, noise, period)
        if words:
            return [f"{form.effect}: {words}"]
    return []
