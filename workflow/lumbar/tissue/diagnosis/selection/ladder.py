"""The error ladder of effects that somebody named: what each takes away, what is left beside the noise, and what that says."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.selection.candidate import Candidate, is_adequate
from lumbar.tissue.diagnosis.selection.verdict import distinguishing_digits, effects_text, noise_sentence


def ladder_sentences(path: Sequence[Candidate], experiment: Experiment) -> list[str]:
    """Return base, base and first effect, … with their errors, then the noise floor and the verdict.

    Parameters
    ----------
    path : sequence of Candidate
        Base, base and first effect, ….
    """
    unit = experiment.output_unit
    training = distinguishing_digits([item.train_rms for item in path], 4)
    unseen = distinguishing_digits([item.test_rms for item in path], 4)
    names = [path[0].fit.structure.base.name, *(f"+ {name}" for name in path[-1].effects)]
    changes = ["", *(f" ({_change(*pair)})" for pair in pairwise(path))]
    rungs = [
        f"{name}: {own} {unit} in training, {other} unseen{change}"
        for name, own, other, change in zip(names, training, unseen, changes, strict=True)
    ]
    return [*rungs, noise_sentence(experiment), ladder_verdict(path, experiment)]


def _change(before: Candidate, after: Candidate) -> str:
    change = 100 * (after.test_rms / before.test_rms - 1)
    return f"{change:+.2g} %" if abs(change) < 10 else f"{change:+.0f} %"


def ladder_verdict(path: Sequence[Candidate], experiment: Experiment) -> str:
    """Say whether what the last model leaves is noise, and which effects gain no more than their parameters cost.

    The cost is that of the search: the likelihood of all records against half the logarithm of their size for every
    parameter (Schwarz, Ann. Statist. 6 (1978) 461-464).
    """
    idle = [after.effects[-1] for before, after in pairwise(path) if after.score >= before.score]
    words = [_left(path, experiment)]
    if idle:
        words.append(
            f"These records do not speak for {effects_text(idle)}: no more is gained than parameters cost."
        )
    if len(idle) < len(path) - 1:
        words.append("Whether other effects do as well, diagnose says.")
    return " ".join(words)


def _left(path: Sequence[Candidate], experiment: Experiment) -> str:
    """Whether what the last model leaves is noise, as far as the noise is known."""
    floor, model = experiment.floor, path[-1]
    still = "still " if model.effects else ""
    if floor is None:
        return f"Verdict: whether something is {still}missing cannot be said."
    times = max(model.train_rms, model.test_rms) / floor.rms
    left = f"what is left is {times:{'.2f' if times < 10 else '.0f'}} times the noise floor at most"
    if is_adequate(model, experiment):
        return f"Verdict: {left}, noise as far as can be told."
    return f"Verdict: something is {still}missing: {left}; locate says where it is."
