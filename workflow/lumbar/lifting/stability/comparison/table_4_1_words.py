"""Words and numbers that Table 4.1 and the table of its controls share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.settings.plain import plain

if TYPE_CHECKING:
    from lumbar.settings.stability import StabilitySettings


def headline_words(settings: StabilitySettings) -> str:
    """Say the headline's sign, time and mass."""
    pendulum = settings.pendulum
    sign = {"inverted": "as people stand", "hanging": "hanging"}[pendulum.sign]
    return ", ".join([sign, f"{pendulum.time} time", pendulum.mass.replace("_", " ")])


def regulator_sentence(settings: StabilitySettings) -> str:
    """Say what regulator all basins have."""
    regulator, pendulum = settings.regulator, settings.pendulum
    return (
        f"Regulator of all basins: Q = {plain(regulator.state_weight)}, R = {regulator.control_weight:g}, "
        f"Qf = {plain(regulator.terminal_weight)}; b = {pendulum.damping_N_m_s:g} N·m·s/rad; it is assumed, the same for all"
    )


def comparison_definition(settings: StabilitySettings) -> str:
    """Say what the comparisons are."""
    first, second = settings.compare.groups
    return (
        f"{first}_vs_{second}: 100(A_{first} − A_{second})/A_{second} with the heaviest box of both; decrease_in_mass_…: "
        "100(A_light − A_heavy)/A_heavy with that lifter's heaviest and lightest box; A = (1/T)∫πρ/√det S dt in rad²/s"
    )


def number_or_none(value) -> float | None:
    """Return a number, or None for what could not be computed."""
    return None if value is None or np.isnan(value) else float(value)
