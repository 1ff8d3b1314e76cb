"""FMU code against the catalogue of effects: the same names, places and forces."""

from __future__ import annotations

import numpy as np
import pytest
from effect_entries import BASE_NUMBERS, FORM_NUMBERS, effect_entry

from lumbar.runtime.effect_forms import BASES, FORMS
from lumbar.runtime.effect_model import effect_model

catalogue = pytest.importorskip("lumbar.effects.catalogue", reason="the catalogue of effects is not there")
base_models = pytest.importorskip("lumbar.effects.base")

SAMPLING_TIME = 0.001
FROM = 500
"""First sample compared: 0.5 s."""
NEEDS_DERIVATIVE = {
    "coulomb_friction/coulomb": 0.05,
    "coulomb_friction/stribeck": 0.05,
    "depth_dependent_damping/bilinear": 0.02,
    "depth_dependent_damping/one_sided": 0.02,
    "quadratic_damping/quadratic": 0.02,
    "quadratic_damping/sinh": 0.02,
    "inertia/mass": 0.05,
    "delay/pure": 1e-3,
}
"""Forms that see a derivative, which the FMU takes by backward differences, or interpolate: their error as a share of
the largest force that the form adds, at 1 kHz and up to 4 Hz. A backward difference is half a sample late."""


def forms():
    return {form.key: form for effect in catalogue.TISSUE.values() for form in effect.forms}


def motion():
    from lumbar.effects.motion import Motion

    time = np.arange(4000) * SAMPLING_TIME
    position = sum(
        amplitude * np.sin(2 * np.pi * frequency * time + phase)
        for amplitude, frequency, phase in ((1.0, 0.5, 0.3), (0.4, 1.7, 1.1), (0.15, 4.0, 2.0))
    )
    return Motion(time, position, SAMPLING_TIME)


def test_every_form_of_the_catalogue_has_c_code_under_the_same_names():
    for key, form in forms().items():
        ours = FORMS[key]
        assert ours.place.value == form.place.value
        assert ours.amplitudes == tuple(item.name for item in form.amplitudes)
        assert ours.shapes == tuple(item.name for item in form.shapes)
    assert set(forms()) == set(FORM_NUMBERS)


def test_bases_are_those_of_the_catalogue():
    assert set(BASES) == set(base_models.BASES)
    for name, keys in BASES.items():
        base = base_models.BASES[name]
        assert [item for key in keys for item in FORMS[key].amplitudes] == [item.name for item in base.amplitudes]
        assert [item for key in keys for item in FORMS[key].shapes] == [item.name for item in base.shapes]


@pytest.mark.parametrize("key", FORM_NUMBERS)
def test_forces_are_those_of_the_catalogue(key):
    from lumbar.effects.structure import Structure

    moved, (amplitudes, shapes) = motion(), BASE_NUMBERS["KB"]
    bare = Structure(base_models.BASES["KB"])
    added = bare.with_form(forms()[key])
    numbers = [np.array([*base, *own]) for base, own in zip((amplitudes, shapes), FORM_NUMBERS[key], strict=True)]
    expected = added.simulate(moved, *numbers)
    found = effect_model(effect_entry("KB", key), SAMPLING_TIME).response(moved.position)
    share = np.abs(expected - bare.simulate(moved, np.array(amplitudes), np.array(shapes)))[FROM:].max()
    assert share > 1e-3, "the effect must be felt in this motion"
    error = np.abs(found - expected)[FROM:].max()
    assert error <= NEEDS_DERIVATIVE.get(key, 1e-9) * share, (error, share)
