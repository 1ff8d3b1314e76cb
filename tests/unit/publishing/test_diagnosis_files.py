"""The files of a diagnosis, and its interactive page: numbers, sentences, one file with the same bytes."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import lumbar
from lumbar.tissue.diagnosis.evidence.discrimination import separating_excitation


@pytest.fixture(scope="module")
def html(page):
    return page.to_html()


@pytest.fixture(scope="module")
def saved(diagnosis, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved")
    (folder / "separating_excitation.csv").write_text("of an earlier diagnosis")
    diagnosis.save(folder)
    return folder


def test_static_page_needs_no_network_and_no_script(diagnosis):
    page = diagnosis.to_html()
    assert "<script" not in page
    assert "http" not in re.sub(r'base64,[^"]*', "", page)
    assert page.count("<math") >= 4


def test_json_keeps_the_contract_and_adds_keys(diagnosis, saved):
    content, contract = json.loads((saved / "diagnosis.json").read_text()), diagnosis.result.to_json()
    assert {key: content[key] for key in contract} == json.loads(json.dumps(contract))
    more = {"headline", "ties", "separating_excitation", "false_alarm_threshold", "detectable_rms", "data"}
    assert set(content) - set(contract) == more
    assert content["separating_excitation"] is None


def test_tables_and_pictures_are_written_and_old_files_removed(saved):
    names = {path.name for path in saved.iterdir() if path.suffix not in (".html", ".tex")}
    drawn = ("comparison", "location", "ladder", "signatures")
    pictures = {f"{name}.{ending}" for name in drawn for ending in ("svg", "pdf")}
    tables = {"ladder.csv", "compare.csv", "location.csv", "diagnosis.json", "refined.json"}
    assert names == pictures | tables
    assert b"Coulomb friction" in (saved / "signatures.svg").read_bytes()


def test_every_model_is_drawn_as_its_fit_simulates_it(diagnosis, page):
    drawn = {model.key: model for model in page.models}
    tried = {"+".join(sorted(item.effects)) for item in diagnosis.result.tried}
    assert {"coulomb_friction", "hysteresis", "inertia"} < tried
    assert {"base"} | tried == {key for key, model in drawn.items() if model.group == "with effects"}
    for key, model in zip(("base", "coulomb_friction"), diagnosis.models, strict=True):
        for record in diagnosis.records:
            simulated = model.simulate(record)
            error, scale = drawn[key].errors[record.name], drawn[key].scales[record.name]
            assert np.allclose(scale * error, record["output"] - simulated, atol=0.51 * scale)
            first = min(50, len(record) // 20)
            measured = record["output"][first:]
            vaf = 100 * (1 - np.var(measured - simulated[first:]) / np.var(measured))
            assert drawn[key].merits[record.name]["vaf"] == pytest.approx(vaf)


def test_thesis_models_equal_those_of_identify(page, example_records):
    settings = lumbar.StudySettings(tissue={"bootstrap": {"resamples": 100}})
    identification = lumbar.identify(example_records, "multisine", settings=settings)
    drawn = {model.key: model for model in page.models}
    other = example_records["other"]
    for estimator in ("arx", "output_error"):
        for name in ("KB", "HO"):
            simulated = identification.get(name, estimator).simulate(other)
            error, scale = (
                getattr(drawn[f"{name}:{estimator}"], part)["other"] for part in ("errors", "scales")
            )
            assert np.allclose(scale * error, other["output"] - simulated, atol=0.51 * scale)
    first = min(50, len(other) // 20)
    unseen = (other["output"] - identification["KB"].simulate(other))[first:]
    assert drawn["KB:arx"].test_rms == pytest.approx(np.sqrt(np.mean(unseen**2)))
    assert drawn["IL:given"].group.endswith("given")


def test_samples_know_the_nearest_reversal(page):
    """After a reversal the motion goes in the direction that the sample knows, before it in the other."""
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


def test_page_is_one_file_with_the_same_bytes(page, html):
    assert len(html) < 8e6
    elements = re.sub(r"<script.*?</script>", "", html, flags=re.S)  # what these load is tested in a browser
    assert not re.search(r'(src|href)\s*=\s*["\'](https?:)?//', elements)
    assert replace(page).to_html() == html


def test_script_has_models_errors_and_sentences(diagnosis, html):
    data = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', html, flags=re.S)
    content = json.loads(data[1])
    assert content["selected"] == ["coulomb_friction"]
    assert content["models"]["coulomb_friction"]["test_rms"] == diagnosis.result.model.test_rms
    located, location = content["models"]["base"]["located"]["other"], diagnosis.reports[1].location
    assert located["headline"] == f"{location.size}. Where it appears:"
    assert set(located["views"].values()) == {view.sentence for view in location.views.values()}
    offered = {name for _, effects in located["places"] for name in effects}
    assert "coulomb_friction" in offered <= set(content["effects"])
    assert content["noise_rms"] == diagnosis.result.experiment.floor.rms


def test_source_label_is_shown_and_not_run(html):
    assert "a lab" in html and "</script><script>alert(1)" not in html
    assert "alert(1)" in html


def test_thinning_of_long_records_is_stated(page):
    thinned, columns = replace(page, max_values=20000), len(page.models) + 6
    samples = sum(len(record.columns["time"]) for record in thinned.records)
    assert samples * columns <= 20000 * 1.01 + columns * len(thinned.records)
    assert thinned.models[1].merits == page.models[1].merits
    longest = max(thinned.records, key=lambda item: len(item.record))
    assert longest.step > 1
    assert f"one sample in {longest.step} of {longest.name}" in thinned.to_html()


def test_page_of_tie_has_separating_excitations(diagnosis, page):
    rival = next(
        item.candidate for item in diagnosis.result.ranking if item.candidate.effects == ("hysteresis",)
    )
    tied = replace(diagnosis.result, status="tied", tied_with=[rival])
    separation = separating_excitation(tied)
    page = replace(page, result=tied, evidence=replace(page.evidence, separation=separation), others=())
    files = page.variables()["content"]["excitations"]
    assert set(files) == {"coulomb_friction", "hysteresis"}
    played = np.loadtxt(io.StringIO(files["hysteresis"]["file"]), delimiter=",", skiprows=1)
    assert played[:, 1] == pytest.approx(separation.excitation.motion.position, abs=1e-4)
