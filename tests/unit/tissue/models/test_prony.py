"""Prony series, read back from the files of FEBio and Abaqus and compared with the simulated relaxation of the model."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from effect_entries import QUASI_LINEAR_NUMBERS, base_model, effect_entry

import lumbar
from lumbar.records.record import Channel, Record
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.prony import prony_series
from lumbar.tissue.models.structure import ForwardStructure
from refusing import has_tokens, refusal

STEP = 5e-4
TIME = STEP * np.arange(4000)


def relaxed(model) -> np.ndarray:
    """Simulate a step and its hold, as a share of the elastic response at once."""
    position = np.where(np.arange(len(TIME)) > 0, 1e-4, 0.0)
    channels = {
        "input": Channel(position, "position", model.input.unit),
        "output": Channel(0 * position, "force", "N"),
    }
    force = model.simulate(Record("step", TIME, channels))
    return force[1:] / (prony_series(model).instantaneous * 1e-4)


def read_febio(text: str) -> tuple[float, list[tuple[float, float]]]:
    root = ET.fromstring(text.encode())
    values = {item.tag: float(item.text) for item in root}
    return values["g0"], [(values[f"g{n}"], values[f"t{n}"]) for n in range(1, 7) if f"g{n}" in values]


def read_abaqus(text: str) -> tuple[float, list[tuple[float, float]]]:
    keyword, *lines = [line for line in text.splitlines() if not line.startswith("**")]
    assert keyword == "*VISCOELASTIC, TIME=PRONY"
    rows = [list(map(float, line.split(","))) for line in lines]
    assert all(shear == bulk for shear, bulk, _ in rows)
    return 1 - sum(shear for shear, _, _ in rows), [(shear, time) for shear, _, time in rows]


MODELS = [
    ("KB",),
    ("Maxwell",),
    ("KB", "second_relaxation/maxwell_branch"),
    *((name,) for name in QUASI_LINEAR_NUMBERS),
]


@pytest.mark.parametrize("names", MODELS, ids="+".join)
def test_files_give_the_simulated_relaxation(names, tmp_path):
    model = FittedModel.from_json(effect_entry(*names), catalogues_with([]))
    xml, inp = (path.read_text(encoding="utf-8") for path in lumbar.export_prony(model, tmp_path))
    # The step takes one sample.
    simulated, time = relaxed(model), TIME[1:] - STEP / 2
    for (rest, terms), error in ((read_abaqus(inp), 2e-3), (read_febio(xml), 2e-2)):
        assert rest >= -1e-8
        assert rest + sum(share for share, _ in terms) == pytest.approx(1, abs=1e-8)
        series = rest + sum(share * np.exp(-time / tau) for share, tau in terms)
        late = time > 20 * STEP
        np.testing.assert_allclose(simulated[late], series[late], atol=error)


@pytest.mark.parametrize(
    ("names", "tokens"),
    [
        (("KV",), "KV … dashpot"),
        (("LE",), "LE … relax"),
        (("KB", "coulomb_friction/coulomb"), "coulomb_friction … not linear"),
        (("KB", "hardening_stiffness/cubic"), "hardening_stiffness … not linear"),
        (("KB", "drift/settling"), "drift"),
        (("KB", "delay/pure"), "delay"),
        (("QLV", "second_relaxation/maxwell_branch"), "QLV … second_relaxation"),
    ],
)
def test_models_without_a_series_are_refused(names, tokens):
    model = FittedModel.from_json(effect_entry(*names), catalogues_with([]))
    assert has_tokens(refusal(prony_series, model), tokens)
    assert "no Prony series" in refusal(prony_series, model)


def test_a_model_from_force_to_motion_has_the_same_series():
    model = base_model("QLV")
    forward = replace(
        model, structure=ForwardStructure(model.structure.base), input=model.output, output=model.input
    )
    assert prony_series(forward).abaqus() == prony_series(model).abaqus()


def test_a_spectrum_fits_into_six_terms():
    fewer, error = prony_series(base_model("QLV-power")).limit_terms(6)
    assert len(fewer.terms) == 6
    assert 0 < error < 0.02
