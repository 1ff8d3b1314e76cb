"""Diagnoses by the public function, without the search of a law."""

import lumbar


def diagnose(records, base=None, train=None, **improvement):
    """Return the result of a diagnosis; other arguments are settings of its section in a study."""
    improvement = lumbar.ImprovementSettings(propose_law=False, **improvement)
    settings = lumbar.StudySettings(improvement=improvement)
    return lumbar.diagnose(records, base=base, train=train, settings=settings).result
