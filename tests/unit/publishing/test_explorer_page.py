"""The page that one can look around in: it holds what was computed, nothing from elsewhere, and runs nothing of the data."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import lumbar
from lumbar.publishing.explorer import shown
from lumbar.publishing.explorer.shown import WITH_EFFECTS, candidates_of, drawing_step, model_key
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import BootstrapSettings, TissueSettings
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.identification.metrics import variance_accounted_for
from lumbar.tissue.models.motion import Motion
from lumbar.twin.examples import example_records

EVIL = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def diagnosis():
    return lumbar.diagnose(
        example_records(),
        settings=StudySettings(improvement=ImprovementSettings(most_effects=1)),
        data=f"a lab {EVIL}",
    )


@pytest.fixture(scope="module")
def page(diagnosis):
    return diagnosis.page()


@pytest.fixture(scope="module")
def html(page):
    return page.to_html()


def content(html: str) -> dict:
    found = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', html, flags=re.S)
    return json.loads(found[1])


def test_every_model_of_the_search_is_drawn_as_its_fit_simulates_it(diagnosis, page):
    candidates = {model_key(item.effects): item for item in candidates_of(diagnosis.verdict)}
    fitted = [model for model in page.models if model.group == WITH_EFFECTS]
    assert {"base", "coulomb_friction"} < {model.key for model in fitted} == set(candidates)
    for model in fitted[:3]:
        for record in diagnosis.verdict.experiment.records:
            simulated = candidates[model.key].fit.simulate(Motion.of(record))
            assert np.allclose(model.values[record.name], simulated, rtol=1e-5, atol=1e-6)
            first = round(0.5 / record.sampling_time)
            vaf = variance_accounted_for(record["output"][first:], simulated[first:])
            assert model.merits[record.name]["vaf"] == pytest.approx(vaf)


def test_the_thesis_s_models_stand_beside_as_identify_finds_them(page):
    settings = StudySettings(tissue=TissueSettings(bootstrap=BootstrapSettings(resamples=100)))
    records = example_records()
    found = lumbar.identify(records, "multisine", settings=settings)
    shown = {model.key: model for model in page.models}
    for estimator in ("arx", "output_error"):
        for name in ("KB", "HO"):
            simulated = found.get(name, estimator).simulate(records[1])
            assert np.allclose(shown[f"{name}:{estimator}"].values["other"], simulated, rtol=1e-5, atol=1e-6)
    unseen = records[1]["output"][25:] - found["KB"].simulate(records[1])[25:]
    assert shown["KB:arx"].test_rms == pytest.approx(np.sqrt(np.mean(unseen**2)))
    assert shown["IL:given"].group.endswith("given")


def test_without_them_the_page_says_how_to_get_them(diagnosis):
    page = diagnosis.page(thesis=False)
    assert "lumbar diagnose --pictures" in page.others_remark
    assert {model.group for model in page.models} == {WITH_EFFECTS}


def test_samples_know_the_nearest_reversal(page):
    """From a reversal on the motion goes in the direction that the sample knows, before it in the other."""
    columns = page.records[0].columns
    near = np.flatnonzero(np.abs(columns["since"]) > 0.04)
    moving = np.sign(np.gradient(columns["position"]))[near]
    agrees = moving == np.sign(columns["since"][near]) * columns["turned"][near]
    assert near.size > 100 and np.mean(agrees) > 0.95


def test_spectrum_of_white_error_is_flat_and_has_its_variance(page):
    """The selected model leaves white noise of 0.01 N at 50 Hz: its density is 0.01·√(2/50) N/√Hz at all frequencies."""
    model = next(item for item in page.models if item.key == "coulomb_friction")
    record = next(item for item in page.records if item.name == "multisine")
    density = model.density["multisine"]
    assert np.sqrt(np.mean(density[:-1] ** 2)) == pytest.approx(0.01 * np.sqrt(2 / 50), rel=0.1)
    assert np.median(record.noise) == pytest.approx(0.01 * np.sqrt(2 / 50), rel=0.15)


def test_a_tie_brings_the_file_of_the_excitation_that_settles_it(diagnosis, page):
    rival = next(
        item.candidate for item in diagnosis.verdict.ranking if item.candidate.effects == ("hysteresis",)
    )
    tied = replace(diagnosis.verdict, verdict="tied", tied_with=[rival])
    separation = separating_excitation(tied)
    told = replace(page, verdict=tied, evidence=replace(page.evidence, separation=separation), others=())
    found = told.variables()["content"]["excitations"]
    assert set(found) == {"coulomb_friction", "hysteresis"}
    played = np.loadtxt(io.StringIO(found["hysteresis"]["file"]), delimiter=",", skiprows=1)
    assert played[:, 1] == pytest.approx(separation.excitation.motion.position, abs=1e-4)


def test_page_is_one_file_with_the_same_bytes(diagnosis, page, html):
    assert len(html) < 8e6
    elements = re.sub(r"<script.*?</script>", "", html, flags=re.S)  # what these load is seen in a browser
    assert not re.search(r'(src|href)\s*=\s*["\'](https?:)?//', elements)
    again = replace(page)
    assert again.to_html() == html


def test_script_knows_models_errors_and_sentences(diagnosis, html):
    told = content(html)
    base = told["models"]["base"]
    assert told["selected"] == ["coulomb_friction"]
    assert told["models"]["coulomb_friction"]["test_rms"] == diagnosis.verdict.model.test_rms
    location = diagnosis.base_on_records[1].location
    found = base["located"]["other"]
    assert {found["headline"], *found["views"].values()} == set(location.sentences)
    assert told["noise_rms"] == diagnosis.verdict.experiment.floor.rms


def test_words_of_the_data_are_shown_and_not_run(html):
    assert EVIL not in html
    assert "alert(1)" in html


def test_long_records_are_thinned_and_the_page_says_so(page, monkeypatch):
    monkeypatch.setattr(shown, "MOST_VALUES", 20000)
    models = len(page.models)
    step = drawing_step(page.verdict.experiment.records, models)
    assert step > 1
    thinned = replace(page)
    samples = sum(len(record.columns["time"]) for record in thinned.records)
    assert samples * (models + 6) <= 20000 * 1.01 + (models + 6) * len(thinned.records)
    assert thinned.models[1].merits == page.models[1].merits
    assert f"Every {step}th sample is drawn" in thinned.to_html()
