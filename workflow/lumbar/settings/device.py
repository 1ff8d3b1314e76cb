"""Section runtime.device: the haptic device and the hand on which models are judged."""

from __future__ import annotations

from typing import Literal

from lumbar.settings.key import key, settings


@settings
class DeviceSettings:
    """Haptic device and hand on which every model is judged before it is exported.

    The defaults are a stylus as in the thesis's experiment: light, with little friction, held loosely.
    """

    mass_kg: float = key("Mass that moves with the stylus.", default=0.25, unit="kg", gt=0)
    damping_N_s_m: float = key(
        "Viscous damping of the device itself, without the hand: what makes a sampled force passive.",
        default=5.5,
        unit="N·s/m",
        gt=0,
    )
    hand_stiffness_N_m: float = key(
        "Stiffness with which the hand holds the stylus.", default=300.0, unit="N/m", gt=0
    )
    hand_damping_N_s_m: float = key("Damping of the hand.", default=0.0, unit="N·s/m", ge=0)
    hand_mass_kg: float = key("Mass of the hand that moves with the stylus.", default=0.0, unit="kg", ge=0)
    rate_Hz: float = key(
        "Rate of the servo loop. Where it is faster than the model it repeats the model's force.",
        default=1000.0,
        unit="Hz",
        gt=0,
    )
    delay_ms: float = key(
        "Time from reading the encoder to the force at the motor: computing, bus, amplifier.",
        default=0.0,
        unit="ms",
        ge=0,
        le=1000,
    )
    encoder_um: float = key(
        "Resolution of the position that the device reads; 0 is exact.", default=30.0, unit="µm", ge=0
    )
    unsafe: Literal["warn", "refuse"] = key(
        "What export does with a model that oscillates on this device in this hand: warn says so and exports, refuse "
        "stops with an error.",
        default="warn",
    )
