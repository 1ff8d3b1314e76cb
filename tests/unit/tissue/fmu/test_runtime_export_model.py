"""Which models are exported, what they say of direction and valid range, and what is refused before anything is compiled."""

import json
import xml.etree.ElementTree as ElementTree
import zipfile

import fmpy
import numpy as np
import pytest
from c_programs import ON_LINUX
from driven_fmu import told_meaning
from effect_entries import effect_entry
from runtime_models import RANGE, SETTINGS, about, entry, exported, models_json, selected

import lumbar
from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.models.fitted_model import FittedModel, models_document, read_models
from lumbar.tissue.models.model_data import MotionRange, identifier
from lumbar.tissue.signals.spectrum import motion_range
from lumbar.twin.examples import example_records


def select(content, **changes):
    return selected(content, SETTINGS.model_copy(update=changes))


def test_the_fit_of_the_configured_record_and_estimator_is_taken():
    content = models_json(
        entry("KB", [1.0], [1.0]),
        entry("KB", [2.0], [1.0], trained_on="chirp"),
        entry("KB", [3.0], [1.0], estimator="output_error"),
    )
    assert select(content, models=["KB"])[0].dynamics.numerator == (1.0,)
    assert select(content, models=["KB"], trained_on="chirp")[0].dynamics.numerator == (2.0,)
    assert select(content, models=["KB"], estimator="output_error")[0].dynamics.numerator == (3.0,)


def test_a_fit_that_is_not_there_names_those_that_are():
    with pytest.raises(InputError, match="arx on multisine"):
        select(models_json(), models=["KB"], trained_on="chirp")


def test_an_unstable_model_is_refused_unless_wanted():
    content = models_json(entry("MW", [0.0, 1.0], [1.0, -1.04]))
    with pytest.raises(NumericalError, match=r"MW \(largest \|pole\| 1.04\)"):
        select(content, models=["MW"])
    assert not select(content, models=["MW"], unstable="export")[0].stable


def test_names_that_would_be_the_same_in_c_are_refused():
    content = models_json(entry("KB+drift", [1.0], [1.0]), entry("KB-drift", [1.0], [1.0]))
    with pytest.raises(InputError, match=r"'KB-drift' and 'KB\+drift'"):
        select(content, models=["KB+drift", "KB-drift"])


@pytest.mark.parametrize(
    "name", ["../KB", "KB/x", "", "KB x", "1KB", 'KB"', "KB\n", "aux", "CON.x", "K" * 201]
)
def test_names_that_are_no_file_names_are_refused(name):
    with pytest.raises(InputError, match="name"):
        select(models_json(entry(name, [1.0], [1.0])), models=[name])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"moving_average_ms": 3.0}, "moving_average_ms.*less than a sample.*three samples are 30"),
        ({"moving_average_ms": 6000.0}, "600 samples.*512 in all"),
    ],
)
def test_settings_out_of_range_are_named(changes, words):
    with pytest.raises(InputError, match=words):
        select(models_json(), **changes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (about(0.0, 15.1), "output_offset"),
        (about(float("inf"), 0.0), r"models\.KB: input\.offset: found Infinity, which is not finite"),
        (
            {"structure": {"numerator": [float("nan")], "denominator": [1.0]}},
            "numerator.0: found NaN, which is not finite",
        ),
        ({"structure": {"numerator": [1.0], "denominator": [1.0] + 17 * [0.01]}}, "17 states"),
        ({"structure": {"numerator": [1.0], "denominator": [0.0, 1.0]}}, "improper"),
    ],
)
def test_models_that_cannot_be_exported_are_named(change, words):
    broken = {**entry("KB", [1.0], [1.0]), **change}
    with pytest.raises(InputError, match=words):
        select(models_json(broken), models=["KB"])


def test_identifiers_are_c_names():
    assert identifier("KB+coulomb_friction") == "KB_coulomb_friction"
    assert identifier("2nd") == "_2nd"
    assert identifier("Kraft (Säge)") == "Kraft__S_ge_"


IL = entry("IL", [-0.125], [1.0], trained_on=None, estimator="given", alpha=None, scores={})


def test_il_is_inverted_on_purpose():
    model = exported(IL)
    assert (model.resisting_sign, model.prescribed, model.valid_for) == (-1, True, None)


@pytest.mark.parametrize(
    "key", ["coulomb_friction/coulomb", "delay/pure", "contact_loss/sharp", "drift/linear"]
)
def test_tissue_with_effects_resists_a_push(key):
    model = exported(effect_entry("KB", key, valid_for=RANGE))
    assert (model.resisting_sign, model.valid_for) == (1, MotionRange(**RANGE))


@ON_LINUX
@pytest.mark.parametrize("version", [2, 3])
def test_a_client_reads_who_made_it_and_what_it_holds_for(version, fmu_folder):
    path = fmu_folder / f"KB_fmi{version}.fmu"
    description = fmpy.read_model_description(str(path))
    token = description.guid if version == 2 else description.instantiationToken
    assert description.version == f"{lumbar.__version__}+{token[:8]}"
    assert description.generationTool == f"lumbar {lumbar.__version__}"
    assert description.author == "The lumbar developers"
    assert "MIT" in description.license
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
    sign = {"push": "growing position", "resisting_sign": 1, "prescribed": False}
    assert told_meaning(root) == {**sign, "unit": "mm", **RANGE}
    assert "-2.4 to 2.5 mm" in page and description.version in page


def test_the_range_is_that_of_the_training_record():
    """Of a sine in closed form; of a fit, that of its record."""
    time = np.arange(4000) * 0.01
    covered = motion_range(1.0 + 2.0 * np.sin(2 * np.pi * 0.5 * time), 0.01)
    assert (covered.lowest, covered.highest) == pytest.approx((-1.0, 3.0))
    assert covered.speed == pytest.approx(2.0 * np.pi, rel=1e-2)
    assert (covered.lowest_Hz, covered.highest_Hz) == pytest.approx((0.5, 0.5))
    records = example_records()
    fitted = next(model for model in lumbar.identify(records) if model.name == "KB")
    position = records[fitted.trained_on]["input"]
    assert (fitted.valid_for.lowest, fitted.valid_for.highest) == (position.min(), position.max())


def test_files_carry_the_range_and_older_ones_are_read():
    content = json.loads(json.dumps(models_json(entry("KB", [1.9, -1.2], [1.0, -0.45], valid_for=RANGE))))
    (model,) = read_models(content, CATALOGUES)
    assert model.valid_for == MotionRange(**RANGE)
    assert models_document([model], "test")["models"][0]["valid_for"] == RANGE
    del content["models"][0]["valid_for"]
    assert read_models(content, CATALOGUES)[0].valid_for is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lowest": 3.0}, "valid_for.lowest: 3 above highest 2.5; it must not be"),
        ({"speed": -1.0}, "valid_for.speed: -1; 0 or more is needed"),
        ({"speed": "fast"}, 'valid_for.speed: found "fast"'),
        ({"loudness": 1.0}, "valid_for.loudness: unknown key; allowed: lowest, highest, speed"),
    ],
)
def test_what_is_no_range_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        FittedModel.from_json(entry("KB", [1.9], [1.0], valid_for={**RANGE, **change}), CATALOGUES)
