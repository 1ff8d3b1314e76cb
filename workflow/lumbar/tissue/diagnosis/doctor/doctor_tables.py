"""What could have been seen in a set of records, as tables, sentences and ``doctor.json``."""

from __future__ import annotations

from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.doctor.effect_sizes import STRONGEST, EffectSize
from lumbar.tissue.diagnosis.doctor.examination import Examination, false_alarm
from lumbar.tissue.diagnosis.doctor.fault_telling import FaultTold
from lumbar.tissue.diagnosis.doctor.smallest import CLOSE
from lumbar.tissue.diagnosis.doctor.truth import reaches_floor
from lumbar.tissue.diagnosis.fitting.joint_fit import Fit
from lumbar.tissue.diagnosis.selection.sentences import effects_text, readable
from lumbar.tissue.models.model_data import unit_of

_EFFECTS = {
    "effect": "effect of the catalogue that was put into the records, of which the refined model is the truth",
    "form": "its mathematical form",
    "said": f"what a blind diagnosis said where it is strong ({STRONGEST:g} times the noise, or four times the prediction): "
    "named (alone), tied or mistaken with or for what, told (as a finding), taken up by another base, unexplained, unseen, "
    "refused, not excited (these motions do not call it forth)",
    "smallest_named": f"smallest RMS of its force at which it was named, to within a factor of {CLOSE:g}",
    "smallest_named_over_noise": "the same over the RMS of the noise",
    "predicted": "smallest RMS of its force that a search would select, to first order",
    "predicted_over_noise": "the same over the RMS of the noise",
    "parameters": "its parameters at the smallest size",
    "said_below": "what was said of the largest size tried below it",
    "present": "RMS of its force in the records themselves, where the diagnosis named it",
    "unit": "of smallest_named, predicted and present",
}
_FAULTS = {
    "mistake": "what was put into the records as they are",
    "largest": "the largest size that was tried, where it has one",
    "said": "what was said of it",
    "smallest_told": "the smallest size that was told: by a finding, by an effect that means it, or by a refusal",
    "told_as": "how, in the words of the diagnosis",
    "not_told": "the largest size that was not told, and what was said in its place",
}


def effects_table(found: Examination, data: str) -> Table:
    """From what size on each effect would have been named, as ``doctor.csv`` publishes it."""
    import pandas as pd

    return Table(
        title="From what size on effects would have been named in these records.",
        frame=pd.DataFrame([effect_row(item, found) for item in found.effects], columns=list(_EFFECTS)),
        definitions=_EFFECTS,
        data=data,
        notes=tuple(remarks(found)),
        may_be_empty=frozenset(_EFFECTS) - {"effect", "form", "said", "unit"},
    )


def faults_table(found: Examination, data: str) -> Table:
    """Which mistakes of a recording would have been told, as ``doctor_faults.csv`` publishes it."""
    import pandas as pd

    return Table(
        title="Which mistakes of a recording would have been told.",
        frame=pd.DataFrame([fault_row(item) for item in found.faults], columns=list(_FAULTS)),
        definitions=_FAULTS,
        data=data,
        may_be_empty=frozenset({"largest", "smallest_told", "told_as", "not_told"}),
    )


def effect_row(item: EffectSize, found: Examination) -> dict:
    """One row of the table of effects."""
    experiment = found.truth.verdict.experiment
    fit = item.smallest_fit
    units = experiment.input_unit, experiment.output_unit
    return {
        "effect": item.form.effect,
        "form": item.form.name,
        "said": item.words,
        "smallest_named": item.smallest,
        "smallest_named_over_noise": None if item.smallest is None else item.smallest / item.noise,
        "predicted": item.predicted,
        "predicted_over_noise": None if item.predicted is None else item.predicted / item.noise,
        "parameters": None if fit is None else parameters_text(item, fit, *units),
        "said_below": item.words_below or None,
        "present": item.present,
        "unit": experiment.output_unit,
    }


def parameters_text(item: EffectSize, fit: Fit, input_unit: str, output_unit: str) -> str:
    """Parameters of the effect that was put in, e.g. ``"delay 0.0004 s"``."""
    form = item.form
    linear = fit.linear[len(fit.linear) - len(form.linear) :]
    nonlinear = fit.nonlinear[len(fit.nonlinear) - len(form.nonlinear) :]
    values = zip((*form.linear, *form.nonlinear), (*linear, *nonlinear), strict=True)
    return ", ".join(
        f"{readable(parameter.name)} {value:.3g} {unit_of(parameter.unit, input_unit, output_unit)}"
        for parameter, value in values
    )


def fault_row(item: FaultTold) -> dict:
    """One row of the table of mistakes."""
    largest = max(item.outcomes)
    missed = item.not_told
    return {
        "mistake": item.fault.words,
        "largest": item.fault.size(largest) or None,
        "said": item.outcomes[largest].words,
        "smallest_told": None if item.smallest is None else item.fault.size(item.smallest) or "told",
        "told_as": None if item.as_told is None else _first_sentence(item.as_told.message),
        "not_told": None
        if missed is None
        else f"{item.fault.size(missed[0])}: {missed[1].words}".lstrip(": "),
    }


def _first_sentence(message: str) -> str:
    return message.splitlines()[0].strip() if message else ""


def remarks(found: Examination) -> list[str]:
    """What a reader must know of the records and of what was put into them."""
    truth = found.truth
    verdict, unit = truth.verdict, truth.verdict.experiment.output_unit
    lines = []
    named = effects_text(verdict.selected)
    base = verdict.base.fit.structure.base.name
    model = f"{base} with {named}" if verdict.selected else base
    floor = "the noise floor" if reaches_floor(verdict) else "what it leaves of the records"
    lines.append(f"Taken for the truth: {model}. Noise: {truth.noise:.3g} {unit} RMS, {floor}.")
    if not reaches_floor(verdict):
        lines.append(
            "The model does not reach a known noise floor: everything that it does not explain counts as noise here, and "
            "what is weaker cannot be seen before that is explained."
        )
    if false_alarm(found):
        lines.append(
            f"With nothing put in, {effects_text(found.nothing.others)} was named: read what is mistaken for it with care."
        )
    return lines


def to_json(found: Examination, data: str) -> dict:
    """Return the content of ``doctor.json`` (schema ``lumbar.doctor/1``)."""
    truth = found.truth
    return {
        "schema": "lumbar.doctor/1",
        "data": data,
        "base": truth.fit.structure.base.name,
        "selected": list(truth.verdict.selected),
        "unit": truth.verdict.experiment.output_unit,
        "noise_rms": truth.noise,
        "noise_is_floor": reaches_floor(truth.verdict),
        "nothing_put_in": found.nothing.words,
        "effects": [{**effect_row(item, found), "trials": _trials_json(item)} for item in found.effects],
        "mistakes": [
            {
                "mistake": item.fault.name,
                "sizes": [
                    {
                        "size": size,
                        "said": outcome.words,
                        "message": outcome.message or None,
                    }
                    for size, outcome in item.outcomes.items()
                ],
            }
            for item in found.faults
        ],
        "further_record": None if found.further is None else found.further.to_json(),
    }


def _trials_json(item: EffectSize) -> list[dict]:
    trials = item.trials.trials if item.trials else {}
    return [
        {"over_noise": strength, "said": outcome.words, "message": outcome.message or None}
        for strength, outcome in trials.items()
    ]
