"""Deposits and scenes that the tests of pushes share."""

from __future__ import annotations

import numpy as np

from lumbar.lifting.pushes import contest
from lumbar.lifting.pushes.motion import DepositMotion
from lumbar.lifting.pushes.simulation import Scene, Traits
from lumbar.settings.pushes import PushesSettings

START, STOP = np.deg2rad([2.0, 4.0, 150.0]), np.deg2rad([0.0, 25.0, 155.0])


def deposit(subject="a", mass=75.0, box=15.0, duration=1.2, foot=0.2) -> DepositMotion:
    """Lean forward with least jerk while the arms reach out."""
    time = np.linspace(0.0, duration, 121)
    s, way = time / duration, (STOP - START)[:, None]
    return DepositMotion(
        subject=subject,
        lift=f"{subject}_{box:g}kg",
        mass_kg=mass,
        height_m=1.75,
        box_mass_kg=box,
        time=time,
        angle=START[:, None] + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        rate=way / duration * 30 * (s**2 - 2 * s**3 + s**4),
        acceleration=way / duration**2 * 60 * (s - 3 * s**2 + 2 * s**3),
        lengths=np.array([0.86, 0.5, 0.55]),
        trunk_centre=0.4,
        ankle_height_m=0.04,
        heel_m=0.065,
        toe_m=foot,
    )


def scene_of(motions, settings=None) -> Scene:
    """Everybody as the settings say, without personal spread."""
    settings = settings or PushesSettings()
    one = np.ones(len(motions))
    traits = Traits(one, one, one, settings.controller.delay_s * one)
    return contest.scene_of(motions, settings, traits)
