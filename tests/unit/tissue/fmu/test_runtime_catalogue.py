"""FMU code against the catalogue of effects: the same names, places and forces."""

from __future__ import annotations

import numpy as np
import pytest
from effect_entries import BASE_NUMBERS, FORM_NUMBERS, effect_entry

from lumbar.tissue.effects import catalogue
from lumbar.tissue.fmu.build.effect_model import effect_model
from lumbar.tissue.models import bases as base_models
from lumbar.tissue.models.fitted_model import FittedModel

SAMPLING_TIME = 0.001
FROM = 500
"""First sample compared: 0.5 s."""
BACKWARD = 0.05
REVERSAL = 0.15
"""At a reversal half a sample of 150 mm/s² is 0.075 mm/s, a tenth of the smoothing speed."""
ACCURACY = {
    "coulomb_friction/coulomb": REVERSAL,
    "coulomb_friction/arctangent": REVERSAL,
    "coulomb_friction/stribeck": REVERSAL,
    "depth_dependent_damping/bilinear": BACKWARD,
    "viscous_damping/dashpot": BACKWARD,
    "depth_dependent_damping/one_sided": BACKWARD,
    "depth_dependent_damping/hunt_crossley": BACKWARD,
    "quadratic_damping/quadratic": BACKWARD,
    "quadratic_damping/power": BACKWARD,
    "quadratic_damping/sinh": BACKWARD,
    "inertia/mass": BACKWARD,
    "second_relaxation/maxwell_branch": 1e-3,
    "delay/pure": 1e-3,
    "backlash/play": 1e-3,
    "hysteresis/dahl": 1e-4,
    "hysteresis/bouc_wen": 1e-4,
    "hysteresis/bouc_wen_general": 1e-4,
    "hysteresis/elastoplastic": 1e-4,
    "hysteresis/iwan": 1e-4,
    "contact_loss/sharp": 1e-3,
    "contact_loss/soft": 1e-3,
    "saturation/sharp": 1e-3,
    "saturation/rounded": 1e-3,
    "saturation/soft": 1e-3,
    "softening/whole_force": 1e-3,
}
"""Difference as a share of the largest force that the effect adds, at 1 kHz and up to 4 Hz; 1e-9 for other forms.
A backward difference is half a sample late; relaxations, the delay, play and hysteresis see straight lines between samples,
where the catalogue has a spline through all samples, later ones included; output forms see that difference in the base."""


def forms():
    return {form.key: form for effect in catalogue.TISSUE.values() for form in effect.forms}


def motion():
    from lumbar.tissue.models.motion import Motion

    time = np.arange(4000) * SAMPLING_TIME
    position = sum(
        linear_parameter * np.sin(2 * np.pi * frequency * time + phase)
        for linear_parameter, frequency, phase in ((1.0, 0.5, 0.3), (0.4, 1.7, 1.1), (0.15, 4.0, 2.0))
    )
    return Motion(time, position, SAMPLING_TIME)


@pytest.mark.parametrize("key", FORM_NUMBERS)
def test_forces_are_those_of_the_catalogue(key):
    from lumbar.tissue.models.structure import Structure

    moved, (linear, nonlinear) = motion(), BASE_NUMBERS["KB"]
    bare = Structure(base_models.BASES["KB"])
    numbers = [
        np.array([*base, *own]) for base, own in zip((linear, nonlinear), FORM_NUMBERS[key], strict=True)
    ]
    bare_force = bare.simulate(moved, np.array(linear), np.array(nonlinear))
    expected = bare.with_form(forms()[key]).simulate(moved, *numbers) - bare_force
    found, bare_found = (
        effect_model(
            FittedModel.from_json(effect_entry("KB", *keys), catalogue.CATALOGUES), SAMPLING_TIME
        ).response(moved.position)
        for keys in ((key,), ())
    )
    np.testing.assert_allclose(bare_found[FROM:], bare_force[FROM:], atol=1e-4 * np.abs(bare_force).max())
    share = np.abs(expected)[FROM:].max()
    assert share > 1e-3, "the effect must be felt in this motion"
    error = np.abs(found - bare_found - expected)[FROM:].max()
    assert error <= ACCURACY.get(key, 1e-9) * share, (error, share)
