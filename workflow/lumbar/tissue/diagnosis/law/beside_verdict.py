"""A law where a diagnosis leaves something that no effect of the catalogue explains, and the verdict beside it."""

from __future__ import annotations

from dataclasses import replace

from lumbar.tissue.diagnosis.law.effect_file import finding
from lumbar.tissue.diagnosis.law.proposal import Proposal, propose
from lumbar.tissue.diagnosis.selection.forward_selection import is_adequate
from lumbar.tissue.diagnosis.selection.thresholds import COMPLETE
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_CLEARLY = 0.5
"""Error of a law on the base alone beside that of the effects selected, up to which they are but a likeness of it."""


def law_beside(verdict: Verdict) -> Proposal | None:
    """Look for a law for what a verdict leaves.

    Returns
    -------
    Proposal or None
        None where nothing is known to be left, where the effects named go on with one more that passes and leaves but noise,
        and where records are the wrong way round, so that whatever fits them is no force law.
    """
    goes_on = verdict.further is not None and is_adequate(verdict.further, verdict.experiment, COMPLETE)
    named_on = verdict.complete is False and not goes_on
    if verdict.turned is not None or not (verdict.verdict == "unexplained" or named_on):
        return None
    return propose(verdict.experiment, verdict.base, verdict.model)


def with_law(verdict: Verdict, proposal: Proposal | None) -> Verdict:
    """Return the verdict with the law among its findings, where there is one.

    Where the law stands on the base alone and leaves far less than the effects that were selected, these are but its likeness:
    nothing of the catalogue explains the records.
    """
    if proposal is None or proposal.law is None:
        return verdict
    found = replace(verdict, findings=(*verdict.findings, finding(proposal)))
    alone = not proposal.left_by.effects
    if alone and verdict.selected and proposal.law.candidate.test_rms < _CLEARLY * verdict.model.test_rms:
        return replace(found, verdict="unexplained", tied_with=[])
    return found
