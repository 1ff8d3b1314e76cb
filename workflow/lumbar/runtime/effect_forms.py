"""Which forms of which effects have C code, and the numbers that each function of ``effect_forms.c`` takes.

Names, amplitudes and shapes are those of the catalogue of effects; a form that is missing here cannot be exported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

MAX_DELAY = 256
"""Samples of the longest delay."""


class Place(StrEnum):
    """Where a form acts on the way from position to force."""

    INPUT = "input"
    PARALLEL = "parallel"
    OUTPUT = "output"


def _as_they_are(amplitudes, shapes, sampling_time):
    return (*amplitudes, *shapes)


def _no_memory(parameters) -> int:
    return 0


def _one_number(parameters) -> int:
    return 1


@dataclass(frozen=True)
class CForm:
    """A form with C code.

    Attributes
    ----------
    effect, form : str
        As in the catalogue of effects.
    amplitudes, shapes : tuple of str
        Names of its parameters, in the catalogue's order.
    equation : str
        Plain text, for the documentation of an FMU.
    place : Place
    parameters : callable
        From amplitudes, shapes and sampling time in seconds to the numbers that the C function takes.
    memory : callable
        From these numbers to how many the form keeps from sample to sample.
    """

    effect: str
    form: str
    amplitudes: tuple[str, ...]
    shapes: tuple[str, ...]
    equation: str
    place: Place = Place.PARALLEL
    parameters: Callable[..., tuple[float, ...]] = _as_they_are
    memory: Callable[[tuple[float, ...]], int] = _no_memory

    @property
    def key(self) -> str:
        """Effect and form, e.g. ``"coulomb_friction/coulomb"``."""
        return f"{self.effect}/{self.form}"

    @property
    def function(self) -> str:
        """Name of the C function; a second relaxation is one more branch of the base's kind."""
        effect = "base" if self.effect == "second_relaxation" else self.effect
        return f"{effect}_{self.form}"


def _relaxation(amplitudes, shapes, sampling_time):
    """Pole and gain of q̇ = ż − q/τ for a position that is linear between samples (ramp-invariant)."""
    (time_constant,) = shapes
    ratio = sampling_time / time_constant
    return (*amplitudes, math.exp(-ratio), -math.expm1(-ratio) / ratio)


def _delay(amplitudes, shapes, sampling_time):
    """Whole samples and the share of one that is left over."""
    samples = shapes[0] / sampling_time
    whole = math.floor(samples)
    return (float(whole), samples - whole)


_FORMS = (
    CForm("base", "spring", ("spring_stiffness",), (), "k z"),
    CForm("base", "dashpot", ("viscosity",), (), "b v"),
    CForm(
        "base",
        "maxwell_branch",
        ("branch_stiffness",),
        ("relaxation_time",),
        "k q, dq/dt = v − q/τ",
        parameters=_relaxation,
        memory=_one_number,
    ),
    CForm("hardening_stiffness", "cubic", ("cubic_stiffness",), (), "k₃ z³"),
    CForm(
        "hardening_stiffness",
        "exponential",
        ("hardening_force",),
        ("hardening_length",),
        "F_h sign(z) (exp(|z|/z_h) − 1)",
    ),
    CForm(
        "hardening_stiffness", "bilinear", ("added_stiffness",), ("knee",), "k_b sign(z) max(|z| − z_b, 0)"
    ),
    CForm("quadratic_stiffness", "quadratic", ("quadratic_stiffness",), (), "k₂ z²"),
    CForm("quadratic_stiffness", "two_sided", ("half_difference_of_stiffness",), (), "k± |z|"),
    CForm("coulomb_friction", "coulomb", ("coulomb_force",), ("smoothing_speed",), "F_c tanh(v/v_s)"),
    CForm(
        "coulomb_friction",
        "arctangent",
        ("coulomb_force",),
        ("smoothing_speed",),
        "2/π F_c arctan(v/v_s)",
    ),
    CForm(
        "coulomb_friction",
        "stribeck",
        ("coulomb_force", "breakaway_excess"),
        ("smoothing_speed", "stribeck_speed"),
        "(F_c + ΔF exp(−(v/v_St)²)) tanh(v/v_s)",
    ),
    CForm(
        "hysteresis",
        "dahl",
        ("friction_limit",),
        ("presliding_distance",),
        "F_h r, dr/dz = (1 − r sign(v))/d",
        memory=_one_number,
    ),
    CForm(
        "hysteresis",
        "bouc_wen",
        ("friction_limit",),
        ("presliding_distance",),
        "F_h r, dr/dz = (1 − r² [r v > 0])/d",
        memory=_one_number,
    ),
    CForm(
        "hysteresis",
        "elastoplastic",
        ("friction_limit",),
        ("presliding_distance",),
        "F_h (z − play_d(z))/d",
        memory=_one_number,
    ),
    CForm("contact_loss", "sharp", (), ("limit",), "F → max(F, −F₀)", Place.OUTPUT),
    CForm(
        "contact_loss",
        "soft",
        (),
        ("limit", "corner_width"),
        "F → w ln(1 + exp((F + F₀)/w)) − F₀",
        Place.OUTPUT,
    ),
    CForm(
        "depth_dependent_damping",
        "bilinear",
        ("damping_per_depth", "damping_at_zero"),
        (),
        "λ z v + c v",
    ),
    CForm(
        "depth_dependent_damping",
        "one_sided",
        ("damping_per_depth", "damping_at_zero"),
        (),
        "λ max(z, 0) v + c v",
    ),
    CForm("quadratic_damping", "quadratic", ("quadratic_damping",), (), "c₂ v |v|"),
    CForm(
        "quadratic_damping", "power", ("damping_force",), ("exponent",), "c_n sign(v) |v|^n, v per unit speed"
    ),
    CForm("quadratic_damping", "sinh", ("damping_force",), ("speed_constant",), "F₂ sinh(v/v₂)"),
    CForm("inertia", "mass", ("mass",), (), "m a"),
    CForm(
        "second_relaxation",
        "maxwell_branch",
        ("branch_stiffness",),
        ("relaxation_time",),
        "k₃ q₂, dq₂/dt = v − q₂/τ₂",
        parameters=_relaxation,
        memory=_one_number,
    ),
    CForm(
        "delay",
        "pure",
        (),
        ("delay",),
        "z(t) → z(t − T_d)",
        Place.INPUT,
        parameters=_delay,
        memory=lambda parameters: int(parameters[0]) + 1,
    ),
    CForm("saturation", "sharp", (), ("limit",), "F → min(max(F, −F_s), F_s)", Place.OUTPUT),
    CForm("saturation", "soft", (), ("limit",), "F → F_s tanh(F/F_s)", Place.OUTPUT),
    CForm("drift", "linear", ("drift_rate",), (), "r t"),
    CForm("drift", "settling", ("drift_force",), ("settling_time",), "F_d (1 − exp(−t/T_d))"),
    CForm(
        "softening", "path", ("stiffness_lost",), ("path_constant",), "k_s z (1 − exp(−s/s₀)), s = ∫|v| dt"
    ),
    CForm("softening", "time", ("stiffness_lost",), ("time_constant",), "k_s z (1 − exp(−t/T_s))"),
    CForm(
        "softening",
        "whole_force",
        (),
        ("share_lost", "path_constant"),
        "F → F (1 − a (1 − exp(−s/s₀))), s = ∫|v| dt",
        Place.OUTPUT,
    ),
    CForm(
        "periodic_disturbance",
        "sine",
        ("sine_amplitude", "cosine_amplitude"),
        ("frequency",),
        "A sin(2π f t) + B cos(2π f t)",
    ),
    CForm("backlash", "play", (), ("half_gap",), "z → play_g(z)", Place.INPUT, memory=_one_number),
)

FORMS = {form.key: form for form in _FORMS}
"""Forms with C code by key. Those of the effect ``base`` are what the base models are made of."""

BASES = {
    "LE": ("base/spring",),
    "Maxwell": ("base/maxwell_branch",),
    "KV": ("base/spring", "base/dashpot"),
    "KB": ("base/spring", "base/maxwell_branch"),
}
"""Base models as sums of forms, amplitudes and shapes in that order."""
