"""Chapter perturbations: trials with and without perturbation, against the basin of the unperturbed mean."""

from __future__ import annotations

from typing import Literal

from lumbar.settings.key import key, required, section, settings
from lumbar.settings.layout import MarkerLayout


@settings
class LegMarkers:
    """Markers of legs and feet, for measures of the whole body; null leaves them out."""

    knee: tuple[str, ...] = required("Markers (standard names) whose mean is the knee.", min_length=1)
    ankle: tuple[str, ...] = required("Markers whose mean is the ankle.", min_length=1)
    heel: tuple[str, ...] = required("Markers whose mean is the heel's end of the foot.", min_length=1)
    toe: tuple[str, ...] = required("Markers whose mean is the toes' end.", min_length=1)


@settings
class PerturbationsSettings:
    """Trials with and without perturbation; null where a study has none."""

    subject: str = required("Who moved.", min_length=1)
    body_mass_kg: float = required(
        "Body mass in kg (an assumption where it was not recorded).", unit="kg", ge=20, le=300
    )
    mass_share: float = required("Share of the body mass that the pendulum carries.", gt=0, le=1)
    pivot: tuple[str, ...] = required("Markers (standard names) whose mean is the pivot.", min_length=1)
    top: tuple[str, ...] = required("Markers whose mean is the other end of the segment.", min_length=1)
    centre_share: float = required(
        "Where the centre of mass lies on the way from pivot to top.", gt=0, le=1.5
    )
    plane: Literal["lateral_bending", "flexion_extension"] = required("Plane of the pendulum.")
    unperturbed: tuple[str, ...] = required("Files of the unperturbed trials.", min_length=3)
    perturbed: tuple[str, ...] = required("Files of the perturbed trials.", min_length=1)
    legs: LegMarkers | None = key(
        "Markers of legs and feet, for measures of the whole body; null leaves them out.", default=None
    )
    markers: MarkerLayout = section(default_factory=MarkerLayout)
