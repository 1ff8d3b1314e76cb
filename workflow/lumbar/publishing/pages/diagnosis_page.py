"""The page of a diagnosis: the verdict and its evidence."""

from collections.abc import Mapping
from pathlib import Path

from markupsafe import Markup

from lumbar.publishing.pages.html import (
    comparison_blocks,
    document,
    equation,
    figure,
    heading,
    listing,
    paragraph,
    table,
)
from lumbar.tables.layout import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import ALIKE, Evidence, limitations
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection.candidate import likelihood_ratio
from lumbar.tissue.diagnosis.selection.result import DiagnosisResult, Ranked
from lumbar.tissue.diagnosis.selection.sentences import (
    CONDITIONAL,
    details,
    effects_text,
    headline,
    readable,
    runner_up,
)
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.models.form import Effect


def diagnosis_page(
    diagnosis: DiagnosisResult,
    evidence: Evidence,
    catalogue: dict[str, Effect],
    source_label: str,
    pictures: dict[str, Path | str] | None = None,
    more: Mapping[str, list[Markup]] | None = None,
    sentence: str = "",
) -> str:
    """Return the page.

    Parameters
    ----------
    catalogue : dict of str to Effect
        Source of mechanisms and experiments.
    source_label : str
        Origin of the data.
    pictures : dict of str to (pathlib.Path or str), optional
        SVG files, or their text, by caption; they come before the list of what remains.
    more : mapping of str to list of markupsafe.Markup, optional
        Further sections by title; the first comes before all others.
    sentence : str, optional
        The verdict in one sentence; default `headline`.
    """
    blocks = [
        paragraph(f"Verdict: {diagnosis.status}"),
        paragraph(sentence or headline(diagnosis), "headline"),
    ]
    first, *last = more.items() if more else (("", []),)
    for title, found in (first, *evidence_sections(diagnosis, evidence, catalogue, pictures or {}), *last):
        blocks += [heading(title), *found] if found else []
    return document(f"Diagnosis of the {diagnosis.base.fit.structure.base.name} model", source_label, blocks)


def evidence_sections(
    diagnosis: DiagnosisResult,
    evidence: Evidence,
    catalogue: dict[str, Effect],
    pictures: dict[str, Path | str],
) -> list[tuple[str, list[Markup]]]:
    """Return the sections with the evidence by title; parameters as in `diagnosis_page`."""
    floor, unit = diagnosis.experiment.floor, diagnosis.experiment.output_unit
    after = diagnosis.model.test_rms
    noise = (
        f", {after / floor.rms:.3g} times the noise floor."
        if floor
        else "; how much of it is noise is unknown."
    )
    remaining = f"On unseen records {after:.4g} {unit} remain{noise}"
    sections = {
        "What was found, in full": [paragraph(line) for line in details(diagnosis, catalogue)],
        "Before and after": _errors(diagnosis, evidence),
        "How likely is a false alarm?": _false_alarm(diagnosis, evidence),
        "Parameters": _parameters(diagnosis),
        "Can it be told from the others?": [] if evidence.ties is None else _ties(diagnosis, evidence),
        "Pictures": [figure(svg, caption) for caption, svg in pictures.items()],
        "What remains": [
            paragraph(remaining),
            listing(item.location.headline for item in evidence.remaining),
        ],
        "What these records cannot decide": [listing(limitations(diagnosis, evidence))],
    }
    return [(title, found) for title, found in sections.items() if found]


def _errors(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    experiment = diagnosis.experiment
    unit, floor = experiment.output_unit, experiment.floor
    tests = ", ".join(item.name for item in experiment.tests)
    error = "error" if experiment.points else "free-run simulation error, the start of each record aside"
    rows = [_error_row("base", diagnosis.base, None, diagnosis)]
    ranked = {frozenset(item.candidate.effects) for item in diagnosis.ranking}
    rows += [
        _error_row(effects_text(item.effects), item, None, diagnosis)
        for item in diagnosis.path[1:-1]
        if frozenset(item.effects) not in ranked
    ]
    for item in diagnosis.ranking:
        name, role = effects_text(item.candidate.effects), role_of(item, diagnosis)
        rows.append(_error_row(name, item.candidate, item, diagnosis, role))
    errors = (f"training ({unit})", f"unseen ({unit})", "unseen / noise")
    head = ("effects added", "role", "form", *errors, "p", "converged")
    noise = "unknown" if floor is None else f"{floor.rms:.4g} {unit} ({floor.low:.4g} to {floor.high:.4g})"
    what = (
        f"Root mean square of the {error}. Fitted on {experiment.training.name}; unseen: {tests}. Noise floor: {noise}. "
        "Each set of effects is refitted together with the base; the ranking is by the likelihood of all records."
    )
    blocks = [paragraph(what), table(head, rows)]
    if evidence.remaining:  # none of points without a clock
        blocks += [heading("The selected model on every record", 3), *comparison_blocks(evidence.remaining)]
    return blocks


def role_of(item: Ranked, diagnosis: DiagnosisResult) -> str:
    """Return what a candidate is to the verdict: selected, tied with it, the runner-up, or nothing."""
    effects = set(item.candidate.effects)
    if effects == set(diagnosis.selected):
        return "selected"
    if any(effects == set(other.effects) for other in diagnosis.tied_with):
        return "tied"
    return "runner-up" if item is runner_up(diagnosis) else ""


def _error_row(
    name: str, candidate, ranked: Ranked | None, diagnosis: DiagnosisResult, role: str = ""
) -> tuple:
    floor = diagnosis.experiment.floor
    return (
        name,
        role,
        ", ".join(readable(form.name) for form in candidate.fit.structure.forms) or "–",
        f"{candidate.train_rms:.4g}",
        f"{candidate.test_rms:.4g}",
        "–" if floor is None else f"{candidate.test_rms / floor.rms:.4g}",
        "–" if ranked is None else probability(ranked.p_value).removeprefix("p = ").removeprefix("p "),
        "yes" if candidate.fit.converged else "no",
    )


def _false_alarm(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    percent = f"{100 * LEVEL:g}"
    if diagnosis.experiment.points:
        return [
            paragraph(
                "Where nothing is missing, the best of all forms tried gains as much in the share p of the cases at most "
                "(F test, times their number). To be selected, an effect needs "
                f"{percent} % or less, and a significantly smaller error on unseen points."
            )
        ]
    chance = (
        "Where nothing is missing, the best of all candidates still gains: in "
        f"{len(evidence.null.ratios)} simulated experiments of the base alone, refitted each time, twice the logarithm of "
        f"the likelihood rose by more than {evidence.threshold:.3g} in {percent} % (allowing for the number of forms tried "
        "here). An effect needs more than that, and a smaller error on unseen records, to be selected."
    )
    if diagnosis.selected:
        gain = likelihood_ratio(diagnosis.base, diagnosis.model, diagnosis.experiment)
        verb = "gains" if len(diagnosis.selected) == 1 else "gain"
        here = f"Here {effects_text(diagnosis.selected)} {verb} {gain:.4g}."
    else:
        candidates = (item.candidate for item in diagnosis.ranking)
        gains = (likelihood_ratio(diagnosis.base, item, diagnosis.experiment) for item in candidates)
        here = f"Here the best candidate gains {max(gains, default=0.0):.3g}."
    return [paragraph(chance), paragraph(here)]


def _parameters(diagnosis: DiagnosisResult) -> list[Markup]:
    blocks = []
    other = runner_up(diagnosis)
    selected = diagnosis.ranking[0] if diagnosis.selected else None
    for item, role in ((selected, "Selected"), (other, "Runner-up")):
        if item is None:
            continue
        structure = item.candidate.fit.structure
        owners = ["", *structure.effects]
        equations = [("base", structure.base.name, equation(structure.base.latex))]
        equations += [
            (readable(form.effect), readable(form.name), equation(form.latex)) for form in structure.forms
        ]
        rows = [
            (
                readable(found.effect) or "base",
                readable(found.name),
                f"{found.value:.4g}",
                f"{found.low:.4g} to {found.high:.4g}",
                unit_in_print(found.unit),
            )
            for found in sorted(item.estimates, key=lambda one: owners.index(one.effect))
        ]
        blocks += [
            heading(f"{role}: {effects_text(item.candidate.effects)}", 3),
            table(("part", "form", "equation"), equations),
            table(("of", "parameter", "value", "95 % interval", "unit"), rows),
        ]
    return [*blocks, paragraph(CONDITIONAL, "note")] if blocks else []


def _ties(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    ties = evidence.ties
    names = [effects_text(item.effects) for item in ties.candidates]
    alike = [names[index] for index in ties.clusters[0] if index != 0]
    noise = "Noise" if diagnosis.experiment.floor else "What the model leaves"
    angles = (
        "Angle between the force that each candidate adds and that of the selected one, beyond what the base's own "
        "parameters take up, over all records: 0° is the same force, 90° has nothing in common. "
        f"{noise} would hide {ties.resolution:.2g}°."
    )
    cluster = f"No other candidate adds a force like that of {names[0]}."
    if alike:
        apart = "" if diagnosis.tied_with else "; the likelihood tells them apart all the same"
        cluster = (
            f"In one cluster with {names[0]}, their forces pairwise within {max(ALIKE, ties.resolution):.2g}°: "
            f"{', '.join(alike)}{apart}."
        )
    rows = [
        (
            name,
            f"{angle:.1f}",
            str(1 + next(i for i, members in enumerate(ties.clusters) if index in members)),
        )
        for index, (name, angle) in enumerate(zip(names, ties.angles[0], strict=True))
    ]
    blocks = [paragraph(angles), paragraph(cluster), table(("candidate", "angle (°)", "cluster"), rows)]
    if evidence.separation is not None:
        blocks.append(paragraph(separation_sentence(evidence.separation, diagnosis), "headline"))
        blocks.append(paragraph("The signal lies beside this page as separating_excitation.csv.", "note"))
    return blocks
