"""Settings of trials with and without perturbation that tests share."""

from __future__ import annotations

from lumbar.settings.plain import typed
from lumbar.settings.pushes import PerturbationsSettings


def perturbation_settings(**more) -> PerturbationsSettings:
    """A trunk between sacrum and C7 in the sagittal plane."""
    return typed(
        PerturbationsSettings,
        {
            "subject": "S0",
            "body_mass_kg": 70.0,
            "mass_share": 0.678,
            "centre_share": 0.626,
            "pivot": ["SACRUM"],
            "top": ["C7"],
            "plane": "flexion_extension",
            "unperturbed": ("a", "b", "c"),
            "perturbed": ("d",),
            **more,
        },
    )
