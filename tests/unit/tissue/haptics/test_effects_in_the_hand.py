"""No model with an effect is called stable that a push shakes: verdicts against pushes that had no part in them."""

import tempfile
from pathlib import Path

import pytest
from c_programs import ON_LINUX
from effect_entries import FORM_NUMBERS, entry_of_effects
from runtime_models import SETTINGS, models_json

from lumbar.tissue.effects.catalogue import TISSUE, catalogue_with
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.haptics.judgement import judge_exported, run_loop
from lumbar.tissue.haptics.rendered_model import export_at, unpacked
from lumbar.tissue.models.fitted_model import read_models
from study_settings import changed

OWN = {"hertzian_contact/sphere": ([0.4], []), "hertzian_contact/power": ([0.4], [1.7])}
ENCODERS_UM = (0.0, 1.0, 30.0)
PUSHES_MM = (3.0, 0.2, -2.0)


def contradictions(form: str, encoder_um: float, cache: Path, project: Path) -> list[str]:
    """Pushes that shake a loop which the verdict calls stable."""
    catalogue = TISSUE
    if form in OWN:
        catalogue = catalogue_with([project / "examples" / "own_effect" / "hertzian_contact.yaml"])
    entry = entry_of_effects("KB", {form: {**FORM_NUMBERS, **OWN}[form]}, catalogue)
    settings = changed(SETTINGS, compiler_cache=str(cache), device={"encoder_um": encoder_um, "hands": 0})
    exported = export_at(read_models(models_json(entry), {"tissue": catalogue})[0], settings, 1000.0)
    verdict = judge_exported(exported, settings)
    if not verdict.stable:
        return []
    shaken = []
    with tempfile.TemporaryDirectory() as folder:
        (file,) = export_fmus([exported], Path(folder), "", ["host"], cache, versions=["3.0"])
        with unpacked(file) as fmu:
            for push_mm in PUSHES_MM:
                with fmu.stepping() as step:
                    run = run_loop(verdict.model, settings.device, step, push_mm)
                shaken += [] if run.calm else [f"{push_mm:g} mm: {run.outcome}; {verdict.finding}"]
    return shaken


@ON_LINUX
@pytest.mark.nightly
@pytest.mark.parametrize("encoder_um", ENCODERS_UM)
@pytest.mark.parametrize("form", [*FORM_NUMBERS, *OWN])
def test_what_is_called_stable_no_push_shakes(form, encoder_um, zig_cache, project):
    assert contradictions(form, encoder_um, zig_cache, project) == []
