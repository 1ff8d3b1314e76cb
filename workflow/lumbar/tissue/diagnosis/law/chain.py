"""Whether a static curve between linear filters explains what no effect of the catalogue does, and in words what it is."""

from dataclasses import replace

import numpy as np

from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.law.block_structure import (
    BOTH,
    HAMMERSTEIN,
    WIENER,
    BlockStructure,
    block_structure,
)
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_WHERE = {
    WIENER: "The curve acts on what has passed the dynamics: look for it in what measures the {output}, or in what stops it",
    HAMMERSTEIN: "The curve acts on the {input} before any dynamics: look for it in what makes or measures the {input}, or in an "
    "elastic curve that relaxes as a whole (quasi-linear viscoelasticity)",
    BOTH: "Dynamics lie before the curve and behind it",
}
_ENDS = (0.01, 0.5, 0.99)
"""Shares of the curve's range at which its slope is told."""


def with_chain(found: Verdict) -> Verdict:
    """The verdict with the chain that explains the records where no effect does; as it was where there is none."""
    experiment = found.experiment
    tissue = found.base.fit.structure.base
    if found.verdict != "unexplained" or tissue.contact or tissue.system != "tissue":
        return found
    chain = block_structure(experiment, min(found.model.test_rms, found.base.test_rms))
    if chain is None:
        return found
    finding = Finding("block_structure", chain_sentence(chain, found), chain.test_rms, experiment.output_unit)
    return replace(found, chain=chain, findings=(*found.findings, finding))


def chain_sentence(chain: BlockStructure, found: Verdict) -> str:
    """The chain in words: where the curve sits, how it bends, how much it explains."""
    experiment = found.experiment
    unit, low, high = experiment.output_unit, chain.curve.knots[0], chain.curve.knots[-1]
    front, back = _filter_words(chain.front.poles), _filter_words(chain.back.poles)
    words = {
        WIENER: f"{front} and a static curve behind it explain",
        HAMMERSTEIN: f"A static curve and {_lower(back)} behind it explain",
        BOTH: f"A static curve between {_lower(front)} and {_lower(back)} explains",
    }[chain.kind]
    slopes = chain.curve.slope(low + np.array(_ENDS) * (high - low))
    inner = experiment.input_unit if chain.front.is_static else f"{experiment.input_unit} as filtered"
    where = _WHERE[chain.kind].format(input=experiment.input_quantity, output=experiment.output_quantity)
    return (
        f"{words} these records ({chain.kind}): the error on unseen records is {chain.test_rms:.3g} {unit}, of the best linear "
        f"approximation {chain.linear_rms:.3g} {unit}. The curve's slope is {slopes[0]:.3g} at {low:.3g} {inner}, "
        f"{slopes[1]:.3g} in the middle and {slopes[2]:.3g} at {high:.3g}. {where}. It describes these records and names no "
        "mechanism; beyond that range it goes on straight, a guess."
    )


def _filter_words(poles: int) -> str:
    return f"A linear filter of {poles} pole{'s' if poles > 1 else ''}" if poles else "A filter without poles"


def _lower(words: str) -> str:
    return words[0].lower() + words[1:]
