"""Diagnoses without the search of a law: by the public function, or with few candidates."""

import lumbar
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection import diagnosis_steps
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.models.bases import CHOSEN_BY_DATA

FEW = ("hardening_stiffness", "coulomb_friction", "viscous_damping", "drift", "softening")
"""Candidates of tests of which the search is not the subject."""


def diagnose(records, base=None, train=None, **improvement):
    """Return the result of a diagnosis; other arguments are settings of its section in a study."""
    improvement = lumbar.ImprovementSettings(propose_law=False, **improvement)
    settings = lumbar.StudySettings(improvement=improvement)
    return lumbar.diagnose(records, base=base, train=train, settings=settings).result


def diagnose_few(records, base=CHOSEN_BY_DATA, train=None, candidates=FEW, **settings):
    """Return the result of a diagnosis with few candidates, which costs a third."""
    catalogue = {name: TISSUE[name] for name in candidates}
    return diagnosis_steps.diagnose(records, DiagnosisSettings(base, train, catalogue, **settings))
