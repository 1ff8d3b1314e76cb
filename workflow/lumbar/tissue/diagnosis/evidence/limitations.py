"""What a set of records cannot decide, in sentences."""

from __future__ import annotations

import numpy as np

from lumbar.tables.words import unit_in_print
from lumbar.tissue.diagnosis.evidence.evidence import Evidence
from lumbar.tissue.diagnosis.residuals.residual import steady_velocity
from lumbar.tissue.diagnosis.selection.sentences import effects_text, readable
from lumbar.tissue.diagnosis.selection.thresholds import TIED
from lumbar.tissue.diagnosis.selection.verdict import Verdict
from lumbar.tissue.signals.spectrum import occupied_band

_WIDE = 0.5
"""Half width of an interval, as a share of the value, from which on a parameter is poorly known."""
_NAMED = 4
"""Effects named as the hardest to see."""


def undecided(diagnosis: Verdict, evidence: Evidence) -> list[str]:
    """Return one sentence per limit of the evidence."""
    return [
        *_range(diagnosis),
        *_unseen(diagnosis),
        *_noise(diagnosis),
        *_mechanism(diagnosis),
        *_form(diagnosis, evidence),
        *_parameters(diagnosis),
        *_too_small(diagnosis, evidence),
    ]


def _range(diagnosis: Verdict) -> list[str]:
    experiment = diagnosis.experiment
    motions = [item.motion for item in (experiment.training, *experiment.tests)]
    positions = np.concatenate([item.position for item in motions])
    speed = max(float(np.abs(steady_velocity(item.position, item.sampling_time)).max()) for item in motions)
    training = experiment.training.motion
    band = occupied_band(training.position, training.sampling_time)
    bottom, top = (f"{frequency:.2g}" for frequency in band)
    frequencies = f"outside {bottom} to {top} Hz" if bottom != top else f"at a frequency other than {top} Hz"
    unit = experiment.input_unit
    return [
        f"Anything outside {positions.min():.3g} to {positions.max():.3g} {unit}, above {speed:.3g} {unit}/s or "
        f"{frequencies}: the tool did not move there."
    ]


def _unseen(diagnosis: Verdict) -> list[str]:
    experiment = diagnosis.experiment
    if experiment.tests[0].name != experiment.training.name:
        return []
    return [
        "Whether the model holds for another excitation: there is one record only, and its last part stands in for an "
        "unseen one. Record a second excitation."
    ]


def _noise(diagnosis: Verdict) -> list[str]:
    if diagnosis.experiment.floor is not None:
        return []
    return [
        "Whether what remains is noise: no record repeats. Record at least three periods of one excitation and give its period."
    ]


def _mechanism(diagnosis: Verdict) -> list[str]:
    if not diagnosis.tied_with:
        return []
    others = " or ".join(effects_text(item.effects) for item in diagnosis.tied_with)
    return [
        f"Whether it is {effects_text(diagnosis.selected)} or {others}: both explain the records equally well."
    ]


def _form(diagnosis: Verdict, evidence: Evidence) -> list[str]:
    """Other mathematical forms of the selected effects that fit as well."""
    chosen = {form.key for form in diagnosis.model.fit.structure.forms}
    found = [
        f"{readable(form.effect)} as {form.name}"
        for item in evidence.other_forms
        if item.score - diagnosis.model.score < TIED
        for form in item.fit.structure.forms
        if form.key not in chosen
    ]
    if not found:
        return []
    named = " and ".join(form.name for form in diagnosis.model.fit.structure.forms)
    return [f"The mathematical form: {', '.join(found)} explains the records as well as {named}."]


def _parameters(diagnosis: Verdict) -> list[str]:
    if not diagnosis.selected:
        return []
    wide = [
        f"{readable(item.name)} ({item.low:.3g} to {item.high:.3g} {unit_in_print(item.unit)})"
        for item in diagnosis.ranking[0].estimates
        if item.high - item.low > 2 * _WIDE * abs(item.value)
    ]
    return [f"The value of {', '.join(wide)}: the interval is as wide as the value."] if wide else []


def _too_small(diagnosis: Verdict, evidence: Evidence) -> list[str]:
    if not evidence.detectable:
        return []
    unit = diagnosis.experiment.output_unit
    easiest = evidence.detectable[0]
    hardest = sorted(evidence.detectable, key=lambda item: -item.hardest)[:_NAMED]
    listed = ", ".join(
        f"{readable(item.effect)} {item.easiest:.2g} to {item.hardest:.2g}" for item in hardest
    )
    return [
        f"Effects too small to be seen. To be selected, one must add at least {easiest.easiest:.2g} {unit} RMS to the "
        f"training record ({readable(easiest.effect)}); hardest to see in this excitation, depending on their "
        f"parameters: {listed} {unit}."
    ]
