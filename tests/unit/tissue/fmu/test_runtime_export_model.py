"""Selection of models for export, their direction and valid range, and faults that are rejected before compiling."""

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import asdict

import fmpy
import pytest
from c_programs import ON_LINUX
from driven_fmu import read_annotation
from effect_entries import effect_entry
from runtime_models import RANGE, SETTINGS, about, contents, entry, exported, models_json, selected

import lumbar
from lumbar import InputError, NumericalError


def select(content, **changes):
    return selected(content, SETTINGS.model_copy(update=changes))


@pytest.mark.parametrize(
    ("changes", "gain"), [({}, 1.0), ({"trained_on": "chirp"}, 2.0), ({"estimator": "output_error"}, 3.0)]
)
def test_record_and_estimator_of_the_settings_select_the_fit(changes, gain):
    content = models_json(
        entry("KB", [1.0], [1.0]),
        entry("KB", [2.0], [1.0], trained_on="chirp"),
        entry("KB", [3.0], [1.0], estimator="output_error"),
    )
    assert select(content, models=["KB"], **changes)[0].dynamics.numerator == (gain,)


def test_unstable_model_is_rejected_by_default():
    content = models_json(entry("MW", [0.0, 1.0], [1.0, -1.04]))
    with pytest.raises(NumericalError, match=r"MW \(largest \|pole\| 1.04\)"):
        select(content, models=["MW"])
    assert not select(content, models=["MW"], unstable="export")[0].stable


SAME_IN_C = models_json(entry("KB+drift", [1.0], [1.0]), entry("KB-drift", [1.0], [1.0]))


@pytest.mark.parametrize(
    ("content", "changes", "message"),
    [
        (
            models_json(),
            {"models": ["KB"], "trained_on": "chirp"},
            "KB: .*'arx'.*'chirp'.*runtime\\.estimator.*runtime\\.trained_on.*arx on multisine",
        ),
        (SAME_IN_C, {"models": ["KB+drift", "KB-drift"]}, r"'KB-drift'.*'KB\+drift'"),
        (
            models_json(),
            {"moving_average_ms": 3.0},
            r"runtime\.moving_average_ms: 3 ms .*100 Hz.*\b30\b",
        ),
        (models_json(), {"moving_average_ms": 6000.0}, r"runtime\.moving_average_ms: 600 .*100 Hz.*\b512\b"),
        *(
            (
                models_json(entry(name, [1.0], [1.0])),
                {"models": [name]},
                f"name: {re.escape(repr(name)[:100])}",
            )
            for name in ["../KB", "KB/x", "", "KB x", "1KB", 'KB"', "KB\n", "aux", "CON.x", "K" * 201]
        ),
        *(
            (models_json({**entry("KB", [1.0], [1.0]), **change}), {"models": ["KB"]}, message)
            for change, message in [
                (about(0.0, 15.1), r"output_offset: 15\.1.*±15 N.*runtime\.output_limit"),
                (about(float("inf"), 0.0), r"models\.KB: input\.offset: .*\bInfinity\b"),
                (
                    {"structure": {"numerator": [float("nan")], "denominator": [1.0]}},
                    r"models\.KB: structure\.numerator\.0: .*\bNaN\b",
                ),
                (
                    {"structure": {"numerator": [1.0], "denominator": [1.0] + 17 * [0.01]}},
                    r"order: 17\b.*\b16\b",
                ),
                (
                    {"structure": {"numerator": [1.0], "denominator": [0.0, 1.0]}},
                    r"models\.KB: structure\.denominator\.0: 0\b.*\b1\b",
                ),
            ]
        ),
    ],
)
def test_models_and_settings_that_cannot_be_exported_are_rejected(content, changes, message):
    with pytest.raises(InputError, match=message):
        select(content, **changes)


IL = entry("IL", [-0.125], [1.0], trained_on=None, estimator="given", alpha=None, scores={})


def test_il_is_inverted_on_purpose():
    model = exported(IL)
    assert (model.resisting_sign, model.prescribed, model.valid_for) == (-1, True, None)


@pytest.mark.parametrize(
    "key", ["coulomb_friction/coulomb", "delay/pure", "contact_loss/sharp", "drift/linear"]
)
def test_tissue_with_effects_resists_a_push(key):
    model = exported(effect_entry("KB", key, valid_for=RANGE))
    assert (model.resisting_sign, asdict(model.valid_for)) == (1, RANGE)


@ON_LINUX
@pytest.mark.parametrize("version", [2, 3])
def test_description_names_origin_and_valid_range(version, fmu_folder):
    path = fmu_folder / f"KB_fmi{version}.fmu"
    description = fmpy.read_model_description(str(path))
    token = description.guid if version == 2 else description.instantiationToken
    assert description.version == f"{lumbar.__version__}+{token[:8]}"
    assert description.generationTool == f"lumbar {lumbar.__version__}"
    assert "lumbar" in description.author
    assert "MIT" in description.license
    files = contents(path)
    page = files["documentation/index.html"].decode()
    sign = {"push": "growing position", "resisting_sign": 1, "prescribed": False}
    root = ElementTree.fromstring(files["modelDescription.xml"])
    assert read_annotation(root) == {**sign, "unit": "mm", **RANGE}
    assert "-2.4 to 2.5 mm" in page and description.version in page


def loaded(folder, **changes):
    path = folder / "models.json"
    path.write_text(
        json.dumps(models_json(entry("KB", [1.9, -1.2], [1.0, -0.45], **changes))), encoding="utf-8"
    )
    return lumbar.load_models(path)[0]


def test_files_without_a_valid_range_are_read(tmp_path):
    assert asdict(loaded(tmp_path, valid_for=RANGE).valid_for) == RANGE
    assert loaded(tmp_path).valid_for is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lowest": 3.0}, r"models\.KB: valid_for\.lowest: .*\b3\b.*highest.*2\.5"),
        ({"speed": -1.0}, r"models\.KB: valid_for\.speed: .*-1\b.*\b0\b"),
        ({"speed": "fast"}, r'models\.KB: valid_for\.speed: .*"fast"'),
        ({"loudness": 1.0}, r"models\.KB: valid_for\.loudness: .*lowest, highest, speed"),
    ],
)
def test_invalid_ranges_are_rejected(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        loaded(tmp_path, valid_for={**RANGE, **change})
