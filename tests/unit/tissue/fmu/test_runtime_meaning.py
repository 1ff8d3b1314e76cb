"""What FMUs say of direction and valid range, and who made them; where the range comes from."""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as ElementTree
import zipfile

import fmpy
import numpy as np
import pytest
from effect_entries import effect_entry
from runtime_models import RANGE, entry, exported, models_json

import lumbar
from lumbar.base.errors import InputError
from lumbar.tissue.effects.catalogue import CATALOGUES
from lumbar.tissue.fmu.build.meaning import range_text, sign_text
from lumbar.tissue.fmu.conventions import told_meaning
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import MotionRange
from lumbar.tissue.models.models_file import models_document, read_models
from lumbar.tissue.signals.motion_range import motion_range
from lumbar.twin.examples import example_records

IL = entry("IL", [-0.125], [1.0], trained_on=None, estimator="given", alpha=None, scores={})


def test_il_is_inverted_and_says_why():
    model = exported(IL)
    assert model.resisting_sign == -1
    assert "INVERTED on purpose" in sign_text(model)
    assert range_text(model) == "Valid range: not known, prescribed, not fitted to data."


@pytest.mark.parametrize(
    "key", ["coulomb_friction/coulomb", "delay/pure", "contact_loss/sharp", "drift/linear"]
)
def test_tissue_with_effects_resists_a_push(key):
    model = exported(effect_entry("KB", key, valid_for=RANGE))
    assert model.resisting_sign == 1
    assert "a positive force resists" in sign_text(model)
    assert "-2.4 to 2.5 mm, to 41 mm/s, 0.1 to 5 Hz" in range_text(model)


def test_data_with_the_other_sign_are_no_purpose():
    model = exported(entry("KB", [-1.9, 1.2], [1.0, -0.45]))
    assert sign_text(model).startswith(
        "INVERTED, as the data it was identified from: a growing position gives"
    )
    assert "its file does not say" in range_text(model)


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the FMUs are built for x86_64 Linux: use such a machine"
)
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
    told = told_meaning(root)
    assert told == {
        "push": "growing position",
        "resisting_sign": 1,
        "prescribed": False,
        "unit": "mm",
        **RANGE,
    }
    for words in ("-2.4 to 2.5 mm", "a positive force resists", "not one step per call", description.version):
        assert words in page


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
        ({"speed": "fast"}, "valid_for.speed: 'fast'"),
        ({"loudness": 1.0}, "valid_for.loudness: unknown key; known are lowest, highest, speed"),
    ],
)
def test_what_is_no_range_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        FittedModel.from_json(entry("KB", [1.9], [1.0], valid_for={**RANGE, **change}), CATALOGUES)
