"""A force that leads the position: no tissue answers before it is moved, so channels or sensors are not on one clock."""

from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import fit_base
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.fitting.uncertainty import estimates
from lumbar.tissue.diagnosis.selection.candidate import Candidate, evaluate, is_adequate, refit, with_forms
from lumbar.tissue.diagnosis.selection.thresholds import EXPLAINS, TIED
from lumbar.tissue.diagnosis.selection.verdict import effects_text
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.structure import Structure

_BASES = ("LE", "KB")
"""Tissues beside which a lead is looked for: the others make up for one by a dashpot of their own."""
_SAMPLES = (5, 14, 23)
"""Longest lead that is looked for first, and next where it may be longer: a delay reaches over ten samples."""
_ROOM = 4
"""Times as many samples that must count in every record."""
_LEAST = 0.2
"""Samples of delay up to which the lead may be longer."""
_STARTS = (4.0, 1.5)
"""Samples that the search for the delay begins at."""


def force_leads(model: Candidate, experiment: Experiment, linear: set[str]) -> Finding | None:
    """By how much the force leads, where that explains all records surely better than what was selected; else None.

    The force is put later, and what is then between it and the position is a delay like any other. The effects `linear` are
    left out beside it: dashpots, masses and branches stand in for a lead.
    """
    base = model.fit.structure.base
    replaced = linear & set(model.effects)
    if base.contact or base.own or not (replaced or base.name == "KV" or not is_adequate(model, experiment)):
        return None
    kept = [form for form in model.fit.structure.forms if form.effect not in replaced | {"delay"}]
    shortest = min(data.size for data in (*experiment.training.records, *experiment.tests))
    for samples in (number for number in _SAMPLES if _ROOM * number <= shortest):
        put_late = experiment.with_data(lambda data, by=samples: _late(data, by, by))
        best = _with_delay(model, kept, put_late)
        units = experiment.input_unit, experiment.output_unit
        late = next(item for item in estimates(best.fit, put_late.training, *units) if item.effect == "delay")
        step = experiment.training.motion.sampling_time
        if late.low > 0 and late.value > _LEAST * step:
            break
    else:
        return None  # longer than what can be looked for: it has no size that could be told
    first = samples * step
    same = experiment.with_data(lambda data: _late(data, 0, samples))
    rival = refit(model.fit.structure, model.fit.nonlinear, same)
    likelier = best.score < rival.score - (TIED if best.parameters >= rival.parameters else 0)
    # Beside another effect that is missing a lead may help a little: it is told where nothing is left.
    whole = (
        is_adequate(best, put_late)
        if experiment.floor
        else best.test_rms**2 < (1 - EXPLAINS) * rival.test_rms**2
    )
    if not (best.fit.converged and likelier and whole and late.high < first):
        return None
    low, lead, high = (1e3 * (first - value) for value in (late.high, late.value, late.low))
    words = {"position": experiment.input_quantity, "force": experiment.output_quantity, "lead": lead}
    words |= {"low": low, "high": high, "error": best.test_rms, "refined": rival.test_rms}
    words["model"] = effects_text([best.fit.structure.base.name, *(form.effect for form in kept)])
    return Finding.of("force_leads", lead / 1e3, "s", channel_unit=experiment.output_unit, **words)


def _with_delay(model: Candidate, kept: list[Form], put_late: Experiment) -> Candidate:
    """The likeliest base with a delay, and with effects that the model has."""
    (delay,) = TISSUE["delay"].forms
    acting = with_forms(model.fit, kept).nonlinear[len(model.fit.structure.base.nonlinear) :]
    step = put_late.training.motion.sampling_time
    fits = (
        fit_base(Structure(BASES[name], (*kept, delay)), put_late.training, [*acting, samples * step])
        for name in _BASES
        for samples in _STARTS
    )
    return min((evaluate(fit, put_late) for fit in fits), key=lambda item: item.score)


def _late(data: FitData, samples: int, longest: int) -> FitData:
    """The record with its force so many samples later; of those at its start the `longest` do not count."""
    force = np.concatenate([np.repeat(data.force[:1], samples), data.force[: len(data.force) - samples]])
    return replace(data, force=force, settling=data.settling + longest)
