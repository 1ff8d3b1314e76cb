"""A diagnosis in sentences with numbers."""

from __future__ import annotations

from lumbar.tissue.diagnosis.selection.forward_selection import is_adequate
from lumbar.tissue.diagnosis.selection.ladder_digits import told_apart
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.diagnosis.selection.verdict import Ranked, Verdict
from lumbar.tissue.effects.catalogue import CHANNELS
from lumbar.tissue.models.form import Effect


def readable(name: str) -> str:
    """Name of an effect for a reader."""
    return name.replace("_", " ")


def effects_text(names) -> str:
    """Names of several effects for a reader."""
    *first, last = [readable(name) for name in names] or ["no effect"]
    return f"{', '.join(first)} and {last}" if first else last


def headline(diagnosis: Verdict) -> str:
    """Return the verdict in one sentence."""
    unit, base = diagnosis.experiment.output_unit, diagnosis.base.fit.structure.base.name
    before, after = diagnosis.base.test_rms, diagnosis.model.test_rms
    named = effects_text(diagnosis.selected)
    fall = f"the error on unseen records falls from {' to '.join(told_apart([before, after], 3))} {unit}"
    if diagnosis.turned is not None:
        return f"These records are not what the {base} model takes. {diagnosis.turned.sentence}"
    if diagnosis.verdict == "adequate":
        return f"Nothing is missing: what the {base} model leaves ({before:.3g} {unit}) is noise as far as can be told."
    if diagnosis.verdict == "named":
        added = "it" if len(diagnosis.selected) == 1 else "them"
        return f"The {base} model is missing {named}: with {added} {fall}."
    if diagnosis.verdict == "tied":
        others = ", ".join(effects_text(item.effects) for item in diagnosis.tied_with)
        return (
            f"Something is missing; {named} explains it ({fall}), but {others} cannot be told apart from it."
        )
    tail = f"; the best candidate, {named}, removes too little of it" if diagnosis.selected else ""
    return f"Something is missing from the {base} model and no effect of the catalogue explains it{tail}."


def details(diagnosis: Verdict, catalogue: dict[str, Effect]) -> list[str]:
    """Return what a reader asks next: noise, share explained, runner-up, what would settle a tie."""
    unit, floor = diagnosis.experiment.output_unit, diagnosis.experiment.floor
    lines = [item.sentence for item in diagnosis.findings]
    if not diagnosis.model.fit.converged:
        lines.append(
            f"The fit of {effects_text(diagnosis.selected)} did not converge: its parameters are where the optimiser "
            "stopped and no result."
        )
    if floor is None:
        lines.append("No record repeats, so the noise floor is unknown and completeness cannot be judged.")
    else:
        lines.append(
            f"Noise floor: {floor.rms:.3g} {unit} ({floor.low:.3g} to {floor.high:.3g}) from {floor.periods} periods of "
            f"{floor.period:g} s"
            + (
                "; they are alike to the last digit, and so much the digits leave open."
                if floor.exact
                else "."
            )
        )
        lines += [
            f"Beside noise the periods differ by {words} (RMS {rms:.3g} {unit})."
            for words, rms in floor.structured
        ]
    if diagnosis.selected:
        lines.append(_removed_and_left(diagnosis))
        lines.append(_diagnosed_again(diagnosis))
    if diagnosis.verdict in ("named", "tied"):
        lines += [
            f"{readable(name).capitalize()}: {catalogue[name].mechanism}" for name in diagnosis.selected
        ]
    second = runner_up(diagnosis)
    if second is not None and diagnosis.verdict == "adequate":
        lines.append(
            f"Best candidate: {effects_text(second.candidate.effects)}, error on unseen records "
            f"{second.candidate.test_rms:.3g} {unit}; where nothing is missing the best of all gains as much in "
            f"{100 * second.p_value:.2g} % of the cases ({100 * LEVEL:g} % would be needed)."
        )
    elif second is not None:
        lines.append(
            f"Runner-up: {effects_text(second.candidate.effects)}, error on unseen records "
            f"{second.candidate.test_rms:.3g} {unit}."
        )
    for item in diagnosis.tied_with:
        new = [name for name in item.effects if name not in diagnosis.selected]
        lines += [f"To settle {readable(name)}: {catalogue[name].experiment}." for name in new]
    if diagnosis.tied_with:
        lines += [f"To settle {readable(name)}: {catalogue[name].experiment}." for name in diagnosis.selected]
    return lines + not_tried(diagnosis)


def not_tried(diagnosis: Verdict) -> list[str]:
    """Say which candidates the records left out, and what would have to be recorded for them."""
    columns: dict[str, dict[str, None]] = {}
    for form, missing in diagnosis.not_tried:
        columns.setdefault(form.effect, {}).update({CHANNELS.get(role, role): None for role in missing})
    return [
        f"Not tried: {readable(name)} as measured, for want of {' and '.join(missing)} in the records."
        for name, missing in columns.items()
    ]


def _removed_and_left(diagnosis: Verdict) -> str:
    """What is left, in noise floors, then what was removed: 99 % of a large error may leave many times the noise."""
    share = f"{100 * diagnosis.explainable_share_removed:.1f} % of the variance"
    floor, model = diagnosis.experiment.floor, diagnosis.model
    if floor is None:
        return f"The selected effects remove {share} that the best of all models tried removes."
    removed = f"{share} that a model could explain"
    rms = max(model.train_rms, model.test_rms)
    return (
        f"The error left is {rms / floor.rms:.2f} times the noise floor at most ({rms:.3g} "
        f"{diagnosis.experiment.output_unit}); the selected effects remove {removed}."
    )


def _diagnosed_again(diagnosis: Verdict) -> str:
    unit, floor, model = diagnosis.experiment.output_unit, diagnosis.experiment.floor, diagnosis.model
    if diagnosis.further is not None:
        return (
            f"Diagnosed again, {readable(diagnosis.further.effects[-1])} is missing too: with it the error on unseen "
            f"records falls to {diagnosis.further.test_rms:.3g} {unit}."
        )
    if floor is not None and is_adequate(model, diagnosis.experiment):
        return "What is left is noise as far as can be told."
    left = "something unexplained is left and " if diagnosis.verdict_after == "unexplained" else ""
    if not diagnosis.diagnosed_again:
        return f"{left}no further effect was looked for.".capitalize()
    return f"Diagnosed again, {left}none of the most promising further effects passes."


def runner_up(diagnosis: Verdict) -> Ranked | None:
    """Best of the ranked sets of effects that is not the selected one."""
    chosen = set(diagnosis.selected)
    return next((item for item in diagnosis.ranking if set(item.candidate.effects) != chosen), None)
