"""Whether a static curve between linear filters explains what no effect of the catalogue does, and in words what it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.diagnosis.law.block_structure import BlockStructure, block_structure
from lumbar.tissue.diagnosis.selection.verdict import Verdict

_SAID: dict[str, dict[str, str]] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
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
    return replace(found, chain=chain, findings=(*found.findings, _finding(chain, experiment)))


def _finding(chain: BlockStructure, experiment: Experiment) -> Finding:
    """The chain in words: where the curve sits, how it bends, how much it explains."""
    low, high = chain.curve.knots[0], chain.curve.knots[-1]
    front, back = _filter_words(chain.front.poles), _filter_words(chain.back.poles)
    made_of, where = _SAID[chain.kind]["made_of"], _SAID[chain.kind]["where"]
    return Finding.of(
        "block_structure",
        chain.test_rms,
        experiment.output_unit,
        chain=chain,
        made_of=made_of.format(Front=front, front=_lower(front), back=_lower(back)),
        slopes=chain.curve.slope(low + np.array(_ENDS) * (high - low)),
        ends=(low, high),
        inner=experiment.input_unit if chain.front.is_static else f"{experiment.input_unit} as filtered",
        where=where.format(input=experiment.input_quantity, output=experiment.output_quantity),
    )


def _filter_words(poles: int) -> str:
    return f"A linear filter of {poles} pole{'s' if poles > 1 else ''}" if poles else "A filter without poles"


def _lower(words: str) -> str:
    return words[0].lower() + words[1:]
