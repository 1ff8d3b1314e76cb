"""A tool that is not fastened to the tissue: palpation from above an unknown surface, simulated apart in fine steps."""

import json

import numpy as np
import pytest
from fine_tissue import palpation
from periodic_records import STEP, noise, record

import lumbar
from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.base_choice import find_base
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose
from lumbar.tissue.diagnosis.selection.refine import fitted_model, refine
from lumbar.tissue.effects.catalogue import CATALOGUES, TISSUE
from lumbar.tissue.models.fitted_model import models_document, read_models

RIVALS = {
    name: TISSUE[name]
    for name in ("hardening_stiffness", "contact_loss", "drift", "quadratic_stiffness", "softening")
}
"""The effect that is there in one case, and those that contact has passed for."""
KNOWN = {"spring_stiffness": 1.2, "branch_ratio": 0.8 / 1.2, "relaxation_time": 0.3}


def hardened(depth: float) -> float:
    return 0.05 * depth**3


@pytest.fixture(scope="module")
def pressed():
    return diagnose(palpation(), DiagnosisSettings(catalogue=RIVALS))


@pytest.fixture(scope="module")
def pressed_hard():
    return diagnose(palpation(hardened), DiagnosisSettings(catalogue=RIVALS))


def parameters(result) -> dict[str, float]:
    fit = result.model.fit
    items = (*fit.structure.linear, *fit.structure.nonlinear)
    return dict(zip((item.name for item in items), (*fit.linear, *fit.nonlinear), strict=True))


def test_palpation_has_contact_base_only(pressed):
    assert pressed.base.fit.structure.base.name == "KB-contact"
    assert (pressed.status, pressed.selected) == ("adequate", ())
    assert pressed.experiment.surface == pytest.approx(3.0, rel=0.01)
    assert parameters(pressed) == pytest.approx(KNOWN, rel=0.02)
    assert pressed.base.test_rms == pytest.approx(0.02, rel=0.05)
    (finding,) = (item for item in pressed.findings if item.kind == "surface")
    assert finding.value == pressed.experiment.surface
    assert finding.unit == "mm"


def test_repeated_choice_has_the_same_surface(pressed):
    """Positions count from the surface already."""
    again, base = find_base(pressed.experiment, "KB-contact", {})
    assert again.surface == pytest.approx(pressed.experiment.surface, abs=1e-3)
    assert base.test_rms == pytest.approx(pressed.base.test_rms, rel=1e-3)
    fastened, _ = find_base(pressed.experiment, "KB", {})
    assert fastened.surface == 0.0


@pytest.mark.nightly
def test_hardening_under_contact_is_named(pressed_hard):
    assert (pressed_hard.status, pressed_hard.selected) == ("named", ("hardening_stiffness",))
    assert pressed_hard.experiment.surface == pytest.approx(3.0, rel=0.01)
    result = parameters(pressed_hard)
    assert {name: result[name] for name in KNOWN} == pytest.approx(KNOWN, rel=0.1)
    assert result["cubic_stiffness"] == pytest.approx(0.05, rel=0.05)
    assert pressed_hard.model.test_rms == pytest.approx(0.02, rel=0.05)


def test_fastened_tool_has_no_surface():
    time = np.arange(1000) * STEP
    position = 2 * np.sin(2 * np.pi * 0.4 * time) + np.sin(2 * np.pi * 1.1 * time)
    records = [
        record(position, 1.2 * position + 0.02 * noise(1000, seed), name) for seed, name in enumerate("ab")
    ]
    result = diagnose(records, DiagnosisSettings(catalogue=RIVALS))
    assert not result.base.fit.structure.base.contact
    assert result.experiment.surface == 0.0


@pytest.fixture(scope="module")
def model():
    experiment, path = refine(palpation(), [], DiagnosisSettings(base="KB-contact", catalogue=RIVALS))
    return fitted_model(path[-1], experiment)


def test_surface_is_saved_with_the_model(model):
    (again,) = read_models(json.loads(json.dumps(models_document([model], "test"))), CATALOGUES)
    assert again == model
    assert again.input.offset == pytest.approx(3.0, rel=0.01)


def test_contact_has_no_transfer_function(model):
    with pytest.raises(NumericalError, match=r"^KB-contact\b.*transfer function.*\bcontact\b"):
        model.to_control()


def test_contact_is_not_exported(model, tmp_path):
    with pytest.raises(InputError, match="base KB-contact"):
        lumbar.export_fmu(model, tmp_path / "fmu")
    assert not (tmp_path / "fmu").exists()
