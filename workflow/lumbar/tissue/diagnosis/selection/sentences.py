"""Sentences on the result of a diagnosis: headline, details, and one line per step."""

from collections.abc import Sequence
from itertools import pairwise

from lumbar.base.formats import format_number, percent
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.noise.noise_floor import NoiseFloor
from lumbar.tissue.diagnosis.selection.candidate import ADEQUATE, Candidate, contradictions, is_adequate
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Ranked, Status
from lumbar.tissue.diagnosis.selection.thresholds import EXPLAINS, LEVEL
from lumbar.tissue.effects.catalogue import CHANNELS
from lumbar.tissue.models.form import Effect

CONDITIONAL = (
    "Intervals hold if base and effects are the right ones: what another base would give is not in them."
)
_MAX_DIGITS = 7
"""Largest number of digits of an error: errors that are equal to these digits count as equal."""
_MIN_REPORTED_ERROR = 0.1
"""Smallest reported error of a right model in addition to the noise, in noise floors."""
_LISTED_ERROR_RATIO = 1.5
"""Ratio of the errors of unseen records above which they are listed one by one."""


def distinguishing_digits(values: Sequence[float], fewest: int) -> list[str]:
    """Format numbers with at least `fewest` digits, and with more if different neighbours would otherwise read the same.

    Examples
    --------
    >>> distinguishing_digits([1.42, 1.404, 1.398], 2)
    ['1.42', '1.404', '1.398']
    >>> distinguishing_digits([8700.0, 1796.0], 3)
    ['8700', '1800']
    """
    wanted = sum(f"{a:.{_MAX_DIGITS}g}" != f"{b:.{_MAX_DIGITS}g}" for a, b in pairwise(values))
    for digits in range(fewest, _MAX_DIGITS + 1):
        texts = [format_number(value, digits) for value in values]
        if sum(a != b for a, b in pairwise(texts)) == wanted:
            break
    return texts


def readable(name: str) -> str:
    """Format the name of an effect."""
    return name.replace("_", " ")


def effects_text(names) -> str:
    """Format the names of several effects."""
    *first, last = [readable(name) for name in names] or ["no effect"]
    return f"{', '.join(first)} and {last}" if first else last


def headline(result: DiagnosisResult) -> str:
    """Return the result in one sentence."""
    base = result.base.fit.structure.base.name
    before, after = result.base.test_rms, result.model.test_rms
    named, fall = effects_text(result.selected), error_falls(result)
    if result.orientation is not None:
        return f"These records are not what the {base} model takes. {result.orientation.sentence}"
    if result.status == Status.ADEQUATE:
        return _adequate_headline(result)
    if result.status == Status.NAMED:
        added = "it" if len(result.selected) == 1 else "them"
        more = " and more (named, incomplete)" if result.is_incomplete else ""
        return f"The {base} model is missing {named}{more}: with {added} {fall}."
    if result.status == Status.TIED:
        others = ", ".join(effects_text(item.effects) for item in result.tied_with)
        return (
            f"Something is missing; {named} explains it ({fall}), but cannot be distinguished from {others}."
        )
    missing = f"Something is missing from the {base} model and no effect of the catalogue explains it"
    if not result.selected:
        return f"{missing}."
    s = "s" * (len(result.selected) == 1)
    removed = f"remove{s} {percent(1 - after / before)} of the error on {result.experiment.test_data}."
    if result.explainable_share_removed < EXPLAINS:
        return f"{missing}; it looks a little like {named}, which {removed}"
    return f"{missing}; {named}, which come{s} nearest, {removed}"


def _adequate_headline(result: DiagnosisResult) -> str:
    """Return the headline of a base without missing effects; one record by itself cannot show that nothing is missing."""
    experiment, base = result.experiment, result.base.fit.structure.base.name
    left = "only noise" if experiment.floor is not None else "an error that no effect lowers significantly"
    left = f"the {base} model leaves {left} ({result.base.test_rms:.3g} {experiment.output_unit})"
    if experiment.is_split:
        return f"No missing effect is visible: {left} on {experiment.test_data}. Another motion would test the model."
    return f"Nothing is missing: {left}, as far as these records show."


def explain(result: DiagnosisResult) -> list[str]:
    """Return one line per step: its name, its action or finding, and whether it decided the status."""
    decided = result.decided_by
    return [
        f"{item.step}: {item.reason}" + (f" [decided: {item.status}]" if item is decided else "")
        for item in result.steps
    ]


def model_sentence(model: Candidate, base: Candidate, experiment: Experiment, is_noise: bool) -> str:
    """Describe the unseen error of a model: its fall from that of the base, and whether it is noise."""
    unit, data, floor = experiment.output_unit, experiment.test_data, experiment.floor
    name = base.fit.structure.base.name
    before, after = distinguishing_digits([base.test_rms, model.test_rms], 3)
    error = f"{name} leaves {before} {unit} on {data}"
    if model.effects:
        fall = f"instead of {before} {unit}"
        if model.test_rms >= base.test_rms:
            fall = f"no less than {name} by itself ({before} {unit})"
        error = f"With {effects_text(model.effects)} {name} leaves {after} {unit} on {data}, {fall}"
    if floor is None:
        return f"{error}. No record repeats, so how much of it is noise is unknown."
    error += f", {times_floor(model.test_rms, floor)} times the noise"
    if not is_noise:
        return f"{error}: something is missing."
    if model.test_rms <= ADEQUATE * floor.rms:
        return f"{error}: only noise is left, as far as these records show."
    return f"{error}: no more than a right model would leave."


def error_falls(result: DiagnosisResult) -> str:
    """Report by how much the error on unseen records falls with the selected effects."""
    before, after = result.base.test_rms, result.model.test_rms
    first, last = distinguishing_digits([before, after], 3)
    share, unit = percent(1 - after / before), result.experiment.output_unit
    return f"the error on {result.experiment.test_data} falls by {share}, from {first} to {last} {unit}"


def noise_sentence(experiment: Experiment) -> str:
    """Report the size and source of the noise, or that it is unknown."""
    floor, unit = experiment.floor, experiment.output_unit
    if experiment.points:
        return "The part of noise in the error is unknown: measure the same positions again."
    if floor is None:
        return (
            "No record repeats, so the noise floor is unknown and completeness cannot be judged. If an excitation ramps up or "
            "down, read only the part that repeats: --trim of 'lumbar import', or trim_s in a study."
        )
    sentence = f"Noise floor: {floor.rms:.3g} {unit} ({floor.low:.3g} to {floor.high:.3g})"
    sentence += f" from {floor.periods} periods of {floor.period:g} s"
    if floor.exact:
        sentence += (
            "; the periods are identical to the last digit, so the floor reflects the number of digits only"
        )
    if floor.halves:
        sentence += ", all there are: the difference between their second halves counts as noise"
    if experiment.extra_floor_rms <= _MIN_REPORTED_ERROR * floor.rms:
        return f"{sentence}."
    return (
        f"{sentence}. In addition a right model would leave {experiment.extra_floor_rms:.3g} {unit}: the force of the "
        f"{experiment.input_quantity}'s noise within the band, or a drift that may be a wandering zero. It counts as noise."
    )


def details(result: DiagnosisResult, catalogue: dict[str, Effect]) -> list[str]:
    """Return the details after the headline: noise, explained share, runner-up, experiments that settle a tie."""
    unit, floor, model = result.experiment.output_unit, result.experiment.floor, result.model
    lines = [item.sentence for item in result.findings if item is not result.orientation]
    if any("interval" in line for line in lines):
        lines.append(CONDITIONAL)
    if not model.fit.converged:
        base = result.base.fit.structure.base.name
        named = f"{base} with {effects_text(result.selected)}" if result.selected else base
        lines.append(
            f"The fit of {named} did not converge: its parameters are where the optimiser stopped and no result."
        )
    if result.linear is not None:
        lines.append(
            f"As {result.linear.fit.structure.base.name} these dynamics are in refined.json, with their equation and the "
            "intervals of its parameters, to be compared and exported as any other model."
        )
    lines.append(noise_sentence(result.experiment))
    if floor is not None:
        lines += [
            f"In addition to noise the periods differ by {text} (RMS {rms:.3g} {unit})."
            for text, rms in floor.structured
        ]
    if result.selected:
        lines += [_removed_share(result), remaining_error(result)]
    unseen = model.unseen_rms
    if max(unseen.values()) > _LISTED_ERROR_RATIO * min(unseen.values()):
        listed = ", ".join(f"{name} {rms:.3g}" for name, rms in unseen.items())
        lines.append(f"Error on {result.experiment.test_data}, one by one: {listed} {unit}.")
    if result.status in (Status.NAMED, Status.TIED):
        lines += [
            f"{readable(name).capitalize()}: {catalogue[name].mechanism} {catalogue[name].sensors}".rstrip()
            for name in result.selected
        ]
    second = runner_up(result)
    if second is not None:
        lines.append(_runner_up_sentence(result, second))
    tied = [name for item in result.tied_with for name in item.effects if name not in result.selected]
    tied += result.selected if result.tied_with else ()
    lines += [f"To settle {readable(name)}: {catalogue[name].experiment}." for name in tied]
    return lines + not_tried(result)


def not_tried(result: DiagnosisResult) -> list[str]:
    """Report the candidates that were not tried because of missing channels, with these channels."""
    columns: dict[str, dict[str, None]] = {}
    for form, missing in result.not_tried:
        columns.setdefault(form.effect, {}).update({CHANNELS.get(role, role): None for role in missing})
    return [
        f"Not tried: {readable(name)} as measured, for want of {' and '.join(missing)} in the records."
        for name, missing in columns.items()
    ]


def _runner_up_sentence(result: DiagnosisResult, second: Ranked) -> str:
    """Report the best set of effects that was not selected, and the reason if the base is adequate."""
    base, data, unit = result.base, result.experiment.test_data, result.experiment.output_unit
    rms, of_base = distinguishing_digits([second.candidate.test_rms, base.test_rms], 3)
    error = f"{effects_text(second.candidate.effects)}, error on {data} {rms} {unit}"
    if second.candidate.test_rms > base.test_rms:
        error += f", worse than {base.fit.structure.base.name} by itself ({of_base})"
    if result.status != Status.ADEQUATE:
        return f"Runner-up: {error}."
    if second.p_value <= LEVEL:
        against = contradictions(second.candidate.fit, result.experiment)
        why = against[0] if against else f"on {data} it is not significantly better"
        return f"Best candidate: {error}; its training improvement exceeds chance, but it was not selected: {why}."
    return (
        f"Best candidate: {error}. By chance the best candidate gains as much in {percent(second.p_value)} of the tests in which "
        f"nothing is missing; at most {percent(LEVEL)} is required."
    )


def _removed_share(result: DiagnosisResult) -> str:
    """Report the remaining error in noise floors, then the removed share: 1 % of a large error may be many noise floors."""
    share = f"{percent(result.explainable_share_removed)} of the variance"
    floor, model = result.experiment.floor, result.model
    if floor is None:
        return f"The selected effects remove {share} of the error on {result.experiment.test_data}, noise included."
    rms = max(model.train_rms, model.test_rms)
    unit = result.experiment.output_unit
    return (
        f"The error left is {times_floor(rms, floor)} times the noise floor at most ({rms:.3g} {unit}); the selected effects "
        f"remove {share} that a model could explain."
    )


def times_floor(rms: float, floor: NoiseFloor) -> str:
    """Format an error in noise floors."""
    times = rms / floor.rms
    return f"{times:.2f}" if times < 10 else f"{times:.0f}" if times < 1000 else "more than a thousand"


def remaining_error(result: DiagnosisResult) -> str:
    """Report whether anything is missing from the model with the selected effects."""
    if result.further is not None:
        effect, rms = readable(result.further.effects[-1]), result.further.test_rms
        falls = f"with it the error on {result.experiment.test_data} falls to {rms:.3g} {result.experiment.output_unit}"
        return f"Diagnosed again, {effect} is missing too: {falls}."
    is_explained = result.refined_status != Status.UNEXPLAINED
    if is_explained and result.experiment.floor is not None and is_adequate(result.model, result.experiment):
        return "Only noise is left, as far as these records show."
    left = "" if is_explained else "something unexplained is left and "
    if not result.is_searched_further:
        return f"{left}no further effect was looked for.".capitalize()
    return f"Diagnosed again, {left}none of the most promising further effects passes."


def runner_up(result: DiagnosisResult) -> Ranked | None:
    """Return the best of the ranked sets of effects other than the selected set."""
    chosen = set(result.selected)
    return next((item for item in result.ranking if set(item.candidate.effects) != chosen), None)
