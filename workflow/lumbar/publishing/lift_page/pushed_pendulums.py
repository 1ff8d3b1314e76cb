"""The pendulums of a lift with all that a page needs to push them: loop, feedback, funnel and limits of the torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.stability.extended_basins import binds, torque_limit, torque_range
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels
from lumbar.lifting.stability.funnel.saturation import reference_of
from lumbar.lifting.stability.model.eq_4_2_regulator import ClosedLoops, close_loops
from lumbar.lifting.stability.model.failures import all_or_each
from lumbar.lifting.stability.model.trajectories import Failure, LiftStates, Trajectory, headline

if TYPE_CHECKING:
    from lumbar.settings.stability import StabilitySettings


@dataclass(frozen=True, eq=False)
class PushedPendulum:
    """One pendulum in closed loop about its trajectory."""

    com: str
    plane: str
    clock: str
    """Whether the movement is played as recorded or in one second."""
    constants: dict[str, float]
    """``mass, length, inertia, damping, gravity_torque`` (with its sign), ``control_weight``, ``duration``, and the
    torque's limits ``lowest`` and ``highest``; SI units."""
    columns: dict[str, np.ndarray]
    """Shape (2·knots − 1,): at the knots and halfway between them: reference ``angle`` and ``velocity``, feedforward
    ``torque``, and ``s11``, ``s12``, ``s22`` of V = x̄ᵀSx̄, of which the feedback is K = (s12,
    s22)/(inertia·control_weight)."""
    level: np.ndarray
    """Shape (knots,): ρ of the exact funnel of the loop without limits."""
    binds: bool
    """Whether the torque reaches its limits anywhere in that funnel."""

    @property
    def key(self) -> str:
        """Name in the page."""
        return f"{self.com}/{self.plane}"


def pushed_pendulums(
    states: LiftStates, settings: StabilitySettings
) -> tuple[list[PushedPendulum], list[Failure]]:
    """Close the loops of a lift in the headline's convention and compute their exact funnels.

    Returns
    -------
    pendulums : list of PushedPendulum
    failures : list of Failure
        Of those that have no trajectory or no funnel.
    """
    sound, unsound = states.trajectories(headline(settings, states.facts["pivot"]))
    results, failed = all_or_each(_funnels, sound, settings, basin="exact funnel")
    found = [
        _pushed(item, index, loops, funnels, settings)
        for items, (loops, funnels) in results
        for index, item in enumerate(items)
    ]
    return found, [*unsound, *failed]


def _funnels(items: list[Trajectory], settings: StabilitySettings) -> tuple[ClosedLoops, Funnels]:
    loops = close_loops(items, settings.pendulum.sign, settings)
    return loops, exact_funnels(loops, settings.goal_level)


def _pushed(
    item: Trajectory, index: int, loops: ClosedLoops, funnels: Funnels, settings: StabilitySettings
) -> PushedPendulum:
    pendulums, reference = loops.pendulums, reference_of(loops.pendulums)
    lowest, highest = torque_range(item, settings)
    constants = {
        "mass": item.mass_kg,
        "length": item.length_m,
        "inertia": pendulums.inertia[index],
        "damping": pendulums.damping[index],
        "gravity_torque": pendulums.gravity_torque[index],
        "control_weight": loops.weights.control,
        "duration": item.duration,
        "lowest": lowest,
        "highest": highest,
    }
    columns = {
        "angle": pendulums.angle,
        "velocity": reference.velocity,
        "torque": reference.torque,
        **dict(zip(("s11", "s12", "s22"), np.moveaxis(loops.cost, -1, 0), strict=True)),
    }
    return PushedPendulum(
        item.com,
        item.plane,
        item.clock,
        {name: float(value) for name, value in constants.items()},
        {name: np.ascontiguousarray(values[:, index]) for name, values in columns.items()},
        np.ascontiguousarray(funnels.level[:, index]),
        bool(binds(loops, funnels.level, torque_limit(item, settings))[index]),
    )
