"""Which models are exported, and what is refused before anything is compiled."""

from __future__ import annotations

import pytest
from runtime_models import SETTINGS, about, entry, models_json, selected

from lumbar.base.errors import InputError, NumericalError
from lumbar.tissue.models.model_data import identifier
from study_settings import changed


def select(content, **changes):
    return selected(content, changed(SETTINGS, **changes))


def test_models_come_in_the_configured_order():
    assert [model.name for model in select(models_json(), models=["KB", "IL"])] == ["KB", "IL"]


def test_the_fit_of_the_configured_record_and_estimator_is_taken():
    content = models_json(
        entry("KB", [1.0], [1.0]),
        entry("KB", [2.0], [1.0], trained_on="chirp"),
        entry("KB", [3.0], [1.0], estimator="output_error"),
    )
    assert select(content, models=["KB"])[0].dynamics.numerator == (1.0,)
    assert select(content, models=["KB"], trained_on="chirp")[0].dynamics.numerator == (2.0,)
    assert select(content, models=["KB"], estimator="output_error")[0].dynamics.numerator == (3.0,)


def test_everything_wrong_is_said_at_once():
    with pytest.raises(InputError) as caught:
        select(models_json(), models=["KB", "XX", "YY"])
    assert "XX: no such model" in str(caught.value)
    assert "YY" in str(caught.value)
    assert "IL, MW, KB, HO" in str(caught.value)


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
        ({"device_damping": 2000.0}, "device_damping.*0 to 1000"),
        ({"device_damping": 5.0, "energy_reserve": -1.0}, "energy_reserve"),
        ({"output_rate_limit": float("inf")}, "output_rate_limit"),
        ({"output_limit": 0.0}, "output_limit"),
        ({"output_limit": float("nan")}, "output_limit"),
        ({"gain_limit": 0.5}, "gain_limit"),
    ],
)
def test_settings_out_of_range_are_named(changes, words):
    with pytest.raises(InputError, match=words):
        select(models_json(), **changes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (about(0.0, 15.1), "output_offset"),
        (about(float("inf"), 0.0), r"models\.KB: input\.offset: inf; .*finite number"),
        ({"structure": {"numerator": [float("nan")], "denominator": [1.0]}}, "finite"),
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
