"""Trajectories and weights that the tests of basins of attraction share."""

from __future__ import annotations

import numpy as np

from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, gather
from lumbar.lifting.stability.model.eq_4_2_regulator import check_weights
from lumbar.lifting.stability.model.trajectories import Trajectory

GRAVITY = 9.81
WEIGHTS = check_weights([[1.0, 0.0], [0.0, 0.1]], 1e-3, [[100.0, 0.0], [0.0, 10.0]])


def minimum_jerk(
    start=0.4,
    end=0.05,
    duration=1.5,
    mass=33.0,
    length=1.1,
    samples=400,
    subject="expert",
    box=23.0,
    com="abdomen",
    plane="flexion_extension",
) -> Trajectory:
    """Move smoothly from one angle to another (Flash and Hogan's minimum-jerk polynomial)."""
    time = np.linspace(0.0, duration, samples)
    s, way = time / duration, end - start
    return Trajectory(
        subject=subject,
        experience=subject,
        box_mass_kg=box,
        com=com,
        plane=plane,
        pivot="mid_ankle",
        time=time,
        angle=start + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        angular_velocity=way / duration * 30 * (s**2 - 2 * s**3 + s**4),
        angular_acceleration=way / duration**2 * 60 * (s - 3 * s**2 + 2 * s**3),
        mass_kg=mass,
        length_m=length,
    )


def pendulums_of(items, sign, damping=1.0, gravity=GRAVITY, knots=401) -> Pendulums:
    """Gather trajectories of one sign and damping."""
    return gather(items, [sign] * len(items), [damping] * len(items), gravity, knots)
