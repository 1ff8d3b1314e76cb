"""All forms of all mechanisms, and the ones outside the catalogue."""

from __future__ import annotations

from hidden_effects import channel, damping, friction, outside, stiffness
from hidden_effects.form import HiddenForm
from lumbar.base.errors import InputError

SINGLE = (*stiffness.FORMS, *friction.FORMS, *damping.FORMS, *channel.FORMS)
"""Forms of the catalogue's mechanisms."""
OUTSIDE_FORMS = outside.FORMS
"""Forms of mechanisms that the catalogue does not hold."""
MECHANISMS = tuple(dict.fromkeys(form.mechanism for form in SINGLE))
"""Names of the mechanisms, as diagnoses name them."""
PAIRS = (
    ("coulomb_friction", "hardening_stiffness"),
    ("drift", "quadratic_damping"),
    ("quadratic_stiffness", "coulomb_friction"),
    ("hysteresis", "inertia"),
    ("delay", "hardening_stiffness"),
    ("backlash", "quadratic_damping"),
    ("contact_loss", "periodic_disturbance"),
    ("second_relaxation", "hardening_stiffness"),
    ("softening", "coulomb_friction"),
    ("depth_dependent_damping", "saturation"),
    ("inertia", "quadratic_stiffness"),
    ("periodic_disturbance", "coulomb_friction"),
)
"""Mechanisms that occur together; the form of each is drawn."""


def forms_of(mechanism: str) -> list[HiddenForm]:
    """Forms of one mechanism."""
    return [form for form in SINGLE if form.mechanism == mechanism]


def form_named(label: str) -> HiddenForm:
    """Form by its label ``mechanism:name``.

    Raises
    ------
    InputError
        If the form does not exist.
    """
    for form in (*SINGLE, *OUTSIDE_FORMS):
        if form.label == label:
            return form
    known = ", ".join(form.label for form in (*SINGLE, *OUTSIDE_FORMS))
    raise InputError(f"form of a hidden effect: {label!r}; there are: {known}")
