"""What could have been seen in a set of records: tables, sentences, ``doctor.json`` and what a terminal shows."""

from collections.abc import Sequence

from lumbar.tables.described import described
from lumbar.tables.table import Table
from lumbar.tissue.diagnosis.doctor.effect_sizes import CONFIRMED_AT, STRONG, EffectSize
from lumbar.tissue.diagnosis.doctor.examination import Examination
from lumbar.tissue.diagnosis.doctor.injection import reaches_floor
from lumbar.tissue.diagnosis.selection.verdict import effects_text, readable
from lumbar.tissue.models.model_data import unit_of
from lumbar.tissue.models.motion import SpatialMotion


def effects_table(found: Examination, data: str) -> Table:
    """From what size on each effect would be named, as ``doctor.csv`` publishes it."""
    words = {"confirmed_at": CONFIRMED_AT, "strong": STRONG}
    rows = [effect_row(item, found) for item in found.effects]
    return described(__file__, "doctor", rows, data, words, notes=remarks(found))


def effect_row(item: EffectSize, found: Examination) -> dict:
    """One row of the table of effects."""
    noise = found.truth.noise
    return {
        "effect": item.form.effect,
        "form": item.form.name,
        "predicted": item.predicted,
        "predicted_over_noise": None if item.predicted is None else item.predicted / noise,
        "felt": item.felt,
        "put_in": item.put_in,
        "put_in_over_noise": None if item.put_in is None else item.put_in / noise,
        "said": item.words,
        "parameters": None if item.put_in is None else _parameters_text(item, found),
        "present": item.present,
        "unit": found.truth.verdict.experiment.output_unit,
    }


def _parameters_text(item: EffectSize, found: Examination) -> str:
    """Parameters of the effect that was put in, e.g. ``"delay 0.0004 s"``."""
    form, fit, experiment = item.form, item.injection.at(item.put_in), found.truth.verdict.experiment
    linear = fit.linear[len(fit.linear) - len(form.linear) :]
    nonlinear = fit.nonlinear[len(fit.nonlinear) - len(form.nonlinear) :]
    values = zip((*form.linear, *form.nonlinear), (*linear, *nonlinear), strict=True)
    return ", ".join(
        f"{readable(parameter.name)} {value:.3g} "
        f"{unit_of(parameter.unit, experiment.input_unit, experiment.output_unit)}"
        for parameter, value in values
    )


def remarks(found: Examination) -> list[str]:
    """What a reader must know of the records and of what was put into them."""
    truth = found.truth
    verdict, unit = truth.verdict, truth.verdict.experiment.output_unit
    base = verdict.base.fit.structure.base.name
    model = f"{base} with {effects_text(verdict.selected)}" if verdict.selected else base
    floor = "the noise floor" if reaches_floor(verdict) else "what it leaves of the records"
    lines = [f"Taken for the truth: {model}. Noise: {truth.noise:.3g} {unit} RMS, {floor}."]
    if not reaches_floor(verdict):
        lines.append(
            "The model does not reach a known noise floor: everything that it does not explain counts as noise here, and "
            "what is weaker cannot be seen before that is explained."
        )
    if found.false_alarm:
        lines.append(
            f"With nothing put in, {effects_text(found.nothing.others)} was named: read what is mistaken for it with care."
        )
    return lines


def to_json(found: Examination, data: str) -> dict:
    """Return the content of ``doctor.json`` (schema ``lumbar.doctor/3``)."""
    truth = found.truth
    return {
        "schema": "lumbar.doctor/3",
        "data": data,
        "base": truth.fit.structure.base.name,
        "selected": list(truth.verdict.selected),
        "unit": truth.verdict.experiment.output_unit,
        "noise_rms": truth.noise,
        "noise_is_floor": reaches_floor(truth.verdict),
        "nothing_put_in": found.nothing.words,
        "effects": [
            {**effect_row(item, found), "message": (item.outcome and item.outcome.message) or None}
            for item in found.effects
        ],
        "further_record": None if found.further is None else found.further.to_json(),
    }


_NO_FURTHER = "No further record that was tried would show more than those at hand."
_NOT_SOUGHT = "What further record of several axes would help is not sought."


def terminal_text(found: Examination) -> str:
    """Remarks, a table of effects, and the further record that helps most."""
    parts = ["\n".join(remarks(found))]
    if found.effects:
        parts.append(_effects_text(found))
    if found.further is not None:
        parts.append(found.further.sentence)
    elif found.effects:
        several = isinstance(found.truth.training.motion, SpatialMotion)
        parts.append(_NOT_SOUGHT if several else _NO_FURTHER)
    return "\n\n".join(parts)


def _effects_text(found: Examination) -> str:
    unit, noise = found.truth.verdict.experiment.output_unit, found.truth.noise
    rows = [["effect", f"predicted ({unit})", "in noises", f"felt ({unit})", "put in", "said"]]
    for item in found.effects:
        row = effect_row(item, found)
        numbers = (row[name] for name in ("predicted", "predicted_over_noise", "felt", "put_in_over_noise"))
        rows.append(
            [
                readable(item.form.effect) + ("*" if item.present is not None else ""),
                *("–" if value is None else f"{value:.2g}" for value in numbers),
                row["said"],
            ]
        )
    lines = _in_columns(rows, numbers=(1, 2, 3, 4))
    lines += [
        f"* in your records already: {readable(item.form.effect)}, {item.present:.3g} {unit} RMS, "
        f"{item.present / noise:.2g} times the noise"
        for item in found.effects
        if item.present is not None
    ]
    return "\n".join(lines)


def _in_columns(rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> list[str]:
    """Lines with columns of one width each, numbers to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(
            cell.rjust(width) if column in numbers else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
