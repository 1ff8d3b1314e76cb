"""A force that comes before the position: no tissue does so, and no effect's name stands for it."""

import pytest
from leading_records import leading

from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.diagnose import diagnose


def leads(records, **settings) -> tuple:
    found = diagnose(records, DiagnosisSettings(**settings))
    return found, [item for item in found.findings if item.kind == "force_leads"]


@pytest.mark.parametrize(
    ("lead", "branch", "hardening"),
    [(6, 0.8, 0.0), (6, 0.0, 0.0), (6, 0.0, 0.01), (90, 0.8, 0.0)],
)
def test_a_force_that_leads_is_told_by_how_much_and_named_no_mechanism(lead, branch, hardening):
    """Milliseconds, at samples of 10 ms."""
    found, (told,) = leads(leading(lead, branch, hardening))
    assert told.value == pytest.approx(1e-3 * lead, abs=2e-4) and told.unit == "s"
    assert f"leads the position, by {1e3 * told.value:.3g} ms" in told.sentence
    assert "clocks of the channels differ" in told.sentence
    assert found.verdict == "unexplained"


@pytest.mark.parametrize("mass", [0.0, 0.0004])
def test_a_force_that_does_not_lead_is_not_said_to(mass):
    found, told = leads(leading(0, mass=mass))
    assert not told and found.selected == (("inertia",) if mass else ())
