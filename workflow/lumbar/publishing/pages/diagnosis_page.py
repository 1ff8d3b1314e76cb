"""The page of a diagnosis: the verdict and its evidence."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from markupsafe import Markup

from lumbar.publishing.pages import html
from lumbar.tables.table_layout import unit_in_print
from lumbar.tissue.diagnosis.evidence.discrimination import separation_sentence
from lumbar.tissue.diagnosis.evidence.evidence import ALIKE, Evidence, limitations
from lumbar.tissue.diagnosis.residuals.residual import probability
from lumbar.tissue.diagnosis.selection import sentences
from lumbar.tissue.diagnosis.selection.candidate import Candidate, likelihood_ratio
from lumbar.tissue.diagnosis.selection.diagnosis_result import DiagnosisResult, Ranked, Status
from lumbar.tissue.diagnosis.selection.sentences import effects_text, readable
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL
from lumbar.tissue.models.form import Effect
from lumbar.tissue.models.model_data import FittedParameter


def verdict_chip(diagnosis: DiagnosisResult) -> tuple[str, str]:
    """Return the verdict in a few words, and its colour in the style of all pages."""
    if diagnosis.status == Status.NAMED:
        if diagnosis.is_incomplete:
            return "named, incomplete", "warn"
        return ("complete", "good") if diagnosis.complete else ("named, completeness unknown", "warn")
    return {
        Status.TIED: ("not distinguishable", "warn"),
        Status.UNEXPLAINED: ("unexplained", "bad"),
        Status.ADEQUATE: ("nothing missing", "good"),
    }[diagnosis.status]


def diagnosis_page(
    diagnosis: DiagnosisResult, headline: str, sections: Mapping[str, list[Markup]], source_label: str
) -> str:
    """Return the page of a diagnosis as HTML.

    `diagnosis` has status and base, `headline` is the verdict, `sections` are by title, `source_label` is the data's origin.
    """
    experiment, path = diagnosis.experiment, diagnosis.path
    floor = None if experiment.floor is None else experiment.floor.rms
    top = max(floor or 0.0, *(item.test_rms for item in path)) or 1.0
    names = [
        diagnosis.base.fit.structure.base.name,
        *(f"+ {readable(item.effects[-1])}" for item in path[1:]),
    ]
    steps = [
        (name, f"{item.test_rms:.3g} {experiment.output_unit}", 100 * item.test_rms / top)
        for name, item in zip(names, path, strict=True)
    ]
    noise = (
        "the noise floor is unknown"
        if floor is None
        else f"dashed: noise, {floor:.3g} {experiment.output_unit}"
    )
    blocks = [
        html.summary(verdict_chip(diagnosis), headline, steps, floor and 100 * floor / top),
        html.paragraph(f"Error on {experiment.test_data}; {noise}.", "note"),
        *(html.fold(title, section, title == "Pictures") for title, section in sections.items()),
    ]
    title = f"Diagnosis of the {diagnosis.base.fit.structure.base.name} model"
    return html.document(title, source_label, blocks)


def evidence_sections(
    diagnosis: DiagnosisResult,
    evidence: Evidence,
    catalogue: dict[str, Effect],
    pictures: Mapping[str, Path],
) -> dict[str, list[Markup]]:
    """Return the sections with the evidence by title.

    The `catalogue` has the mechanisms and experiments of `diagnosis` and `evidence`; `pictures` are SVG files by caption.
    """
    sections = {
        "Pictures": [html.figure(svg, caption) for caption, svg in pictures.items()],
        "Parameters": _parameters(diagnosis),
        "How likely is a false alarm?": _false_alarm(diagnosis, evidence),
        "Can it be distinguished from the others?": _ties(diagnosis, evidence),
        "What these records cannot decide": [html.listing(limitations(diagnosis, evidence))],
        "All candidates": _errors(diagnosis, evidence),
        "Result in full": [html.paragraph(line) for line in sentences.details(diagnosis, catalogue)],
        "What remains": [html.paragraph(item.location.headline) for item in evidence.remaining],
    }
    return {title: blocks for title, blocks in sections.items() if blocks}


def _errors(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    experiment = diagnosis.experiment
    unit, floor = experiment.output_unit, experiment.floor

    def row(name: str, candidate: Candidate, role: str = "", p_value: str = "–") -> tuple:
        forms = ", ".join(readable(form.name) for form in candidate.fit.structure.forms) or "–"
        errors = f"{candidate.train_rms:.4g}", f"{candidate.test_rms:.4g}"
        relative = "–" if floor is None else f"{candidate.test_rms / floor.rms:.4g}"
        return name, role, forms, *errors, relative, p_value, "yes" if candidate.fit.converged else "no"

    rows = [row("base", diagnosis.base)]
    ranked = {frozenset(item.candidate.effects) for item in diagnosis.ranking}
    for candidate in diagnosis.path[1:-1]:
        if frozenset(candidate.effects) not in ranked:
            rows.append(row(effects_text(candidate.effects), candidate))
    for item in diagnosis.ranking:
        p_value = probability(item.p_value).removeprefix("p = ").removeprefix("p ")
        name = effects_text(item.candidate.effects)
        rows.append(row(name, item.candidate, candidate_role(item, diagnosis), p_value))
    errors = (f"training ({unit})", f"{experiment.test_data} ({unit})", f"{experiment.test_data} / noise")
    head = ("effects added", "role", "form", *errors, "p", "converged")
    noise = "unknown" if floor is None else f"{floor.rms:.4g} {unit} ({floor.low:.4g} to {floor.high:.4g})"
    error = "error" if experiment.points else "free-run simulation error, without the start of each record"
    tests = ", ".join(item.name for item in experiment.tests)
    unseen = f"tested on {experiment.test_data}" if experiment.is_split else f"unseen: {tests}"
    text = (
        f"Root mean square of the {error}. Fitted on {experiment.training.name}; {unseen}. Noise floor: {noise}. "
        "Each set of effects is refitted together with the base; the ranking is by the likelihood of all records."
    )
    blocks = [html.paragraph(text), html.table(head, rows)]
    if evidence.remaining:  # none of points without a clock
        blocks.append(html.heading("The selected model on every record", 3))
        blocks += html.comparison_blocks(evidence.remaining)
    return blocks


def candidate_role(item: Ranked, diagnosis: DiagnosisResult) -> str:
    """Return the role of a candidate in the verdict: selected, tied, runner-up or empty."""
    effects = set(item.candidate.effects)
    if effects == set(diagnosis.selected):
        return "selected"
    if any(effects == set(other.effects) for other in diagnosis.tied_with):
        return "tied"
    return "runner-up" if item is sentences.runner_up(diagnosis) else ""


def _false_alarm(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    percent = f"{100 * LEVEL:g}"
    if diagnosis.experiment.points:
        text = (
            "p is the share of cases without a missing effect in which the best of all forms gains at least as much (F test, "
            f"times their number). A selected effect needs {percent} % or less, and a significantly smaller error on "
            f"{diagnosis.experiment.test_data}."
        )
        return [html.paragraph(text)]
    chance = (
        "The best of all candidates improves the fit even if nothing is missing. In "
        f"{len(evidence.null.ratios)} simulated experiments of the base only, refitted each time, twice the logarithm of "
        f"the likelihood rose by more than {evidence.threshold:.3g} in {percent} % (for the number of forms tried here). "
        f"A selected effect needs more than that, and a smaller error on {diagnosis.experiment.test_data}."
    )
    if diagnosis.selected:
        gain = likelihood_ratio(diagnosis.base, diagnosis.model, diagnosis.experiment)
        name = effects_text(diagnosis.selected)
    else:
        candidates = (item.candidate for item in diagnosis.ranking)
        gains = (likelihood_ratio(diagnosis.base, item, diagnosis.experiment) for item in candidates)
        gain, name = max(gains, default=0.0), "the best candidate"
    return [html.paragraph(chance), html.paragraph(f"Gain of {name} here: {gain:.4g}.")]


def parameter_tables(candidate: Candidate, estimates: Iterable[FittedParameter]) -> list[Markup]:
    """Return the equations of a model, and its parameters with intervals."""
    structure = candidate.fit.structure
    owners = ["", *structure.effects]
    equations = [("base", structure.base.name, html.equation(structure.base.latex))]
    for form in structure.forms:
        equations.append((readable(form.effect), readable(form.name), html.equation(form.latex)))
    rows = [
        (
            readable(estimate.effect) or "base",
            readable(estimate.name),
            f"{estimate.value:.4g}",
            "not estimated" if estimate.low is None else f"{estimate.low:.4g} to {estimate.high:.4g}",
            unit_in_print(estimate.unit),
        )
        for estimate in sorted(estimates, key=lambda one: owners.index(one.effect))
    ]
    return [
        html.table(("part", "form", "equation"), equations),
        html.table(("part", "parameter", "value", "95 % interval", "unit"), rows),
        html.paragraph(sentences.CONDITIONAL, "note"),
    ]


def _parameters(diagnosis: DiagnosisResult) -> list[Markup]:
    selected = diagnosis.ranking[0] if diagnosis.selected else None
    return [
        block
        for item, role in ((selected, "Selected"), (sentences.runner_up(diagnosis), "Runner-up"))
        if item is not None
        for block in (
            html.heading(f"{role}: {effects_text(item.candidate.effects)}", 3),
            *parameter_tables(item.candidate, item.estimates),
        )
    ]


def _ties(diagnosis: DiagnosisResult, evidence: Evidence) -> list[Markup]:
    ties = evidence.ties
    if ties is None:
        return []
    names = [effects_text(item.effects) for item in ties.candidates]
    noise = "noise" if diagnosis.experiment.floor else "the residual"
    text = (
        "Angle between the force that each candidate adds and that of the selected one, without the part that the base's "
        "parameters can represent, over all records. 0°: the same force; 90°: nothing in common; below "
        f"{ties.resolution:.2g}° {noise} hides the difference."
    )
    cluster = f"No other candidate adds a force like that of {names[0]}."
    alike = [names[index] for index in ties.clusters[0] if index != 0]
    if alike:
        distinguished = "" if diagnosis.tied_with else "; the likelihood still distinguishes them"
        cluster = (
            f"In one cluster with {names[0]}, their forces pairwise within {max(ALIKE, ties.resolution):.2g}°: "
            f"{', '.join(alike)}{distinguished}."
        )
    rows = []
    for index, (name, angle) in enumerate(zip(names, ties.angles[0], strict=True)):
        number = next(number for number, members in enumerate(ties.clusters, 1) if index in members)
        rows.append((name, f"{angle:.1f}", str(number)))
    table = html.table(("candidate", "angle (°)", "cluster"), rows)
    blocks = [html.paragraph(text), html.paragraph(cluster), table]
    if evidence.separation is not None:
        blocks.append(html.paragraph(separation_sentence(evidence.separation, diagnosis), "headline"))
        blocks.append(
            html.paragraph("The signal is in separating_excitation.csv, next to this page.", "note")
        )
    return blocks
