"""A base that did not converge."""

from dataclasses import replace

import lumbar
from lumbar.tissue.diagnosis.selection import refine
from lumbar.twin.examples import example_records


def test_unconverged_base_is_located_and_reported(monkeypatch):
    def stopped(*arguments):
        experiment, base = find_base(*arguments)
        return experiment, replace(base, fit=replace(base.fit, converged=False))

    find_base = refine.find_base
    monkeypatch.setattr(refine, "find_base", stopped)
    bare = lumbar.refine(example_records(), [])
    (finding,) = bare.findings
    assert finding.kind == "not_converged" and finding.record == "multisine"
    assert finding.sentence in str(bare) and finding.sentence in str(bare.locate())
