"""The pages of a diagnosis: as a report, and as one file to explore, with the cards' pictures."""

import base64
import io
import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from periodic_records import STEP, multisine, noise, record, relaxing_force

import lumbar
from lumbar.base.errors import InputError
from lumbar.publishing.explorer.one_file import embed_pictures, one_file, plain_figure
from lumbar.publishing.explorer.page_data import EFFECTS_GROUP, fitted_candidates, model_key
from lumbar.publishing.pages.diagnosis_page import diagnosis_page, evidence_sections
from lumbar.publishing.pages.diagnosis_pictures import draw_pictures
from lumbar.publishing.pages.html import document, figure, listing, paragraph, table
from lumbar.settings.improvement import ImprovementSettings
from lumbar.settings.study_settings import StudySettings
from lumbar.settings.tissue import BootstrapSettings, TissueSettings
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation
from lumbar.tissue.diagnosis.evidence.evidence import (
    EXCITATION,
    detectable_effects,
    diagnosis_document,
    gather_evidence,
    write_diagnosis,
)
from lumbar.tissue.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
from lumbar.tissue.diagnosis.selection.candidate import likelihood_ratio
from lumbar.tissue.diagnosis.selection.diagnose import diagnose
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL, NullDistribution, null_distribution
from lumbar.tissue.effects.catalogue import TISSUE
from lumbar.tissue.effects.signature import RATES, SHARE, signatures, standard_motion
from lumbar.tissue.identification.metrics import settling_time, variance_accounted_for
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.form import Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.printing import equation_mathml
from lumbar.twin.examples import example_records

SIGMA = 0.02


def records(extra=lambda z: 0.0 * z, periods=8):
    first, second = 0.5 * multisine(periods, 500, range(1, 25), 1), 0.5 * multisine(3, 500, range(1, 25), 2)
    return [
        record(first, relaxing_force(first) + extra(first) + SIGMA * noise(len(first), 3), "multisine"),
        record(second, relaxing_force(second) + extra(second) + SIGMA * noise(len(second), 4), "other"),
    ]


@pytest.fixture(scope="module")
def hardening():
    """Diagnosis of records with a cubic spring, with its evidence."""
    tests = records(lambda z: 0.01 * z**3)
    diagnosis = diagnose(tests)
    return diagnosis, gather_evidence(diagnosis, DiagnosisSettings(), 1), tests


def test_page_needs_no_network_and_no_script(hardening):
    diagnosis, evidence, _ = hardening
    page = diagnosis_page(diagnosis, "x", evidence_sections(diagnosis, evidence, TISSUE, {}), "x")
    assert "<script" not in page
    assert "http" not in re.sub(r'base64,[^"]*', "", page)
    assert page.count("<math") >= 4
    for coded in re.findall(r"base64,([^\"]*)", page):
        ElementTree.fromstring(base64.b64decode(coded))


def test_json_keeps_the_contract_and_adds_keys(hardening, tmp_path):
    diagnosis, evidence, _ = hardening
    contract = diagnosis.to_json()
    content = diagnosis_document(diagnosis, evidence, "x")
    assert {key: content[key] for key in contract} == contract
    assert set(content) - set(contract) == {
        "ties", "separating_excitation", "false_alarm_threshold", "detectable_rms", "data",
    }  # fmt: skip
    (tmp_path / EXCITATION).write_text("of an earlier diagnosis")
    write_diagnosis(diagnosis, lambda: evidence, tmp_path, "x")
    assert {path.name for path in tmp_path.iterdir()} == {"diagnosis.json", "ladder.csv"}
    assert json.loads((tmp_path / "diagnosis.json").read_text())["separating_excitation"] is None


def test_pictures_of_a_diagnosis(hardening, tmp_path):
    diagnosis, evidence, _ = hardening
    pictures = draw_pictures(diagnosis, evidence.remaining, TISSUE, tmp_path, "laboratory X")
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{ending}"
        for name in ("comparison", "location", "ladder", "signatures")
        for ending in ("svg", "pdf")
    }
    page = diagnosis_page(diagnosis, "x", evidence_sections(diagnosis, evidence, TISSUE, pictures), "x")
    assert page.count("<figure>") == 4
    assert b"Hardening stiffness" in (tmp_path / "signatures.svg").read_bytes()


def test_an_effect_at_the_detectable_size_gains_the_threshold():
    """Add a force of thrice the stated size to records of the base alone: it gains nine times the threshold."""
    tests = records()
    diagnosis = diagnose(tests)
    assert diagnosis.selected == ()
    found = {item.effect: item for item in detectable_effects(diagnosis, TISSUE, null_distribution())}
    forms = sum(len(effect.forms) for effect in TISSUE.values())
    threshold = null_distribution().threshold(forms)
    # Inertia has one form and no shape: one size is stated.
    stated = found["inertia"]
    assert stated.easiest == pytest.approx(stated.hardest)
    data = diagnosis.experiment.training
    mass = 3 * stated.easiest / np.sqrt(np.mean(data.motion.acceleration[data.first :] ** 2))
    larger = diagnose(records(lambda z: mass * acceleration(z)))
    single = next(item.candidate for item in larger.ranking if item.candidate.effects == ("inertia",))
    # Twice the log-likelihood of a force in noise scatters by 2 √(its mean).
    assert likelihood_ratio(larger.base, single, larger.experiment) == pytest.approx(
        9 * threshold, abs=2.5 * 2 * np.sqrt(9 * threshold)
    )


def acceleration(position: np.ndarray) -> np.ndarray:
    """Second derivative by the spectrum: the records are whole periods of lines up to 4.8 Hz."""
    omega = 2 * np.pi * np.fft.rfftfreq(len(position), STEP)
    return np.fft.irfft(-(omega**2) * np.fft.rfft(position), len(position))


def test_the_threshold_is_the_gain_that_one_in_a_hundred_nulls_reach():
    null = NullDistribution(np.sort(np.random.default_rng(1).chisquare(3, 1000)), 30)
    threshold = null.threshold(30)
    assert null.p_value(threshold, 30) <= LEVEL < null.p_value(threshold - 0.2, 30)
    assert null.threshold(60) > threshold


FORMS = [form for effect in TISSUE.values() for form in effect.forms]


@pytest.mark.parametrize("equation", [form.latex for form in FORMS] + [base.latex for base in BASES.values()])
def test_every_equation_is_set(equation):
    root = ElementTree.fromstring(equation_mathml(equation))
    letters = re.sub(r"\\[A-Za-z]+|[^A-Za-z]", "", equation)
    assert set(letters) <= set("".join(root.itertext()))


@pytest.mark.parametrize(
    "latex", [r"\nonsense{", r"\nonsense x", r"\text{<b>}", r"\text{<script>1</script>}", "", "x^"]
)
def test_an_equation_that_cannot_be_read_is_refused(latex):
    with pytest.raises(InputError, match="not in LaTeX that can be set"):
        equation_mathml(latex)


def test_an_equation_leads_nowhere():
    assert "javascript" not in equation_mathml(r"\href{javascript:alert(1)}{x}")


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.key)
def test_signatures_are_visible_and_as_large_as_said(form):
    slow, fast = signatures(TISSUE[form.effect], form)
    share = np.sqrt(np.mean(slow.added_force**2) / np.mean(slow.base**2))
    assert np.all(np.isfinite(fast.force))
    if form.place is Place.PARALLEL:
        assert share == pytest.approx(SHARE)
    else:
        assert 0.03 < share < 3 * SHARE


def test_signatures_follow_closed_forms():
    position = standard_motion(RATES[0]).position
    cubic = signatures(TISSUE["hardening_stiffness"])[0].added_force
    assert cubic == pytest.approx(cubic.max() * position**3, abs=1e-9 + 1e-4 * cubic.max())
    clipped = signatures(TISSUE["saturation"])[0].force
    assert np.ptp(clipped[np.abs(clipped) > 0.999 * clipped.max()].__abs__()) < 1e-3 * clipped.max()
    slow, fast = signatures(TISSUE["inertia"])
    ratio = np.abs(fast.added_force[600:-10]).max() / np.abs(slow.added_force[600:-10]).max()
    assert ratio == pytest.approx((RATES[1] / RATES[0]) ** 2, rel=0.02)


def test_building_blocks_escape_what_they_are_given(tmp_path):
    page = document("a < b", "x & y", [paragraph("-1 < 2, 3-4"), listing(["<b>"]), table(["<h>"], [["a&b"]])])
    assert "a &lt; b" in page and "x &amp; y" in page and "−1 &lt; 2, 3-4" in page
    assert "<b>" not in page.split("</header>")[1].replace("<p><b>Data", "").replace("</b>", "")
    assert "a&amp;b" in page
    (tmp_path / "empty.svg").write_text("<svg/>")
    assert "<figcaption>a &amp; b</figcaption>" in figure(tmp_path / "empty.svg", "a & b")


def test_numbering_what_bokeh_names_leaves_coded_numbers_alone():
    """A page of the default study could not be opened: among three million letters one run of them was taken for a name."""
    coded = "AAA+p12345/A 01234567-0123-0123-0123-0123456789ab b"
    pictures = embed_pictures(lambda document: document.add_root(plain_figure("a", "", "", 0)))
    variables = {"title": "", "data": "", "content": {"coded": coded}}
    text = one_file(pictures, "publishing/explorer/shell.html.jinja", variables)
    assert coded in text and not re.search(r'"p\d{4,}"', text)


EVIL = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def diagnosis():
    return lumbar.diagnose(
        example_records(),
        settings=StudySettings(improvement=ImprovementSettings(most_effects=1)),
        source_label=f"a lab {EVIL}",
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
    candidates = {model_key(item.effects): item for item in fitted_candidates(diagnosis.result)}
    fitted = [model for model in page.models if model.group == EFFECTS_GROUP]
    assert {"base", "coulomb_friction"} < {model.key for model in fitted} == set(candidates)
    for model in fitted[:3]:
        for item in diagnosis.result.experiment.records:
            simulated = candidates[model.key].fit.simulate(Motion.of(item))
            assert np.allclose(model.values[item.name], simulated, rtol=1e-5, atol=1e-6)
            first = round(settling_time(item) / item.sampling_time)
            vaf = variance_accounted_for(item["output"][first:], simulated[first:])
            assert model.merits[item.name]["vaf"] == pytest.approx(vaf)


def test_the_thesis_s_models_stand_beside_as_identify_finds_them(page):
    settings = StudySettings(tissue=TissueSettings(bootstrap=BootstrapSettings(resamples=100)))
    records = example_records()
    found = lumbar.identify(records, "multisine", settings=settings)
    shown = {model.key: model for model in page.models}
    for estimator in ("arx", "output_error"):
        for name in ("KB", "HO"):
            simulated = found.get(name, estimator).simulate(records[1])
            assert np.allclose(shown[f"{name}:{estimator}"].values["other"], simulated, rtol=1e-5, atol=1e-6)
    first = round(settling_time(records[1]) / records[1].sampling_time)
    unseen = records[1]["output"][first:] - found["KB"].simulate(records[1])[first:]
    assert shown["KB:arx"].test_rms == pytest.approx(np.sqrt(np.mean(unseen**2)))
    assert shown["IL:given"].group.endswith("given")


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
        item.candidate for item in diagnosis.result.ranking if item.candidate.effects == ("hysteresis",)
    )
    tied = replace(diagnosis.result, status="tied", tied_with=[rival])
    separation = separating_excitation(tied)
    told = replace(page, result=tied, evidence=replace(page.evidence, separation=separation), others=())
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
    assert told["models"]["coulomb_friction"]["test_rms"] == diagnosis.result.model.test_rms
    location = diagnosis.reports[1].location
    found = base["located"]["other"]
    assert {found["headline"], *found["views"].values()} == set(location.sentences)
    assert told["noise_rms"] == diagnosis.result.experiment.floor.rms


def test_words_of_the_data_are_shown_and_not_run(html):
    assert EVIL not in html
    assert "alert(1)" in html


def test_long_records_are_thinned_and_the_page_says_so(page):
    thinned, columns = replace(page, max_values=20000), len(page.models) + 6
    assert thinned.step > 1
    samples = sum(len(record.columns["time"]) for record in thinned.records)
    assert samples * columns <= 20000 * 1.01 + columns * len(thinned.records)
    assert thinned.models[1].merits == page.models[1].merits
    assert f"Every {thinned.step}th sample is drawn" in thinned.to_html()
