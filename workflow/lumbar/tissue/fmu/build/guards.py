"""What stands between a model's force and the device: contact, rate, passivity; the same computed in Python."""

import math
from dataclasses import dataclass

import numpy as np

LARGEST = 1e3
"""Upper limit of device damping in N·s/m and energy reserve in J, as in ``sampled_force.c``."""


@dataclass(frozen=True)
class Guards:
    """Guards of the force that the device receives."""

    contact: bool = False
    """The tissue cannot pull, and ends at the input's offset: below it, the model is at rest."""
    rate_limit: float = 0.0
    """Largest change of the force in a second, in its unit; 0 does not limit it."""
    device_damping: float = 0.0
    """Least damping of the device in N·s/m (rotations: N·m·s/rad): with it the force is bounded such that device and FMU
    never give out more energy than they took in. 0 leaves the force unbounded."""
    energy_reserve: float = 0.0
    """Most energy that counts as taken in, in J."""

    @property
    def passive(self) -> bool:
        """Whether device and FMU never give out more energy than they took in."""
        return self.device_damping > 0

    @property
    def active(self) -> bool:
        """Whether the force depends on the forces before it."""
        return self.passive or self.rate_limit > 0


def guard_forces(model, positions: np.ndarray, limited: np.ndarray, event_mode: bool) -> np.ndarray:
    """Return the forces that are read behind rate limit and passivity, each operation as in ``sampled_force.c``.

    The energy is observed as B. Hannaford and J.-H. Ryu do (IEEE Trans. Robotics and Automation 18 (2002) 1-10). A force
    f that is held for a sample T gives f d over the displacement d, and a damping b takes at least b d²/T meanwhile
    (Cauchy and Schwarz), of which the least is −f² T/(4 b): forces within √(4 b E/T) can never give out more than the
    energy E at hand. Without event mode a force may be displayed at once or from the next sample on: both are counted.

    Parameters
    ----------
    positions : numpy.ndarray, shape (samples,), in space (samples, axes)
        In the input's unit.
    limited : numpy.ndarray, shape (samples,)
        Force within its limit and, with contact, never a pull.
    event_mode : bool
        Without it a force is read, and displayed, from the next sample on.
    """
    guards, step, unit = model.guards, model.sampling_time, model.units
    worst = step / (4.0 * guards.device_damping) if guards.passive else math.inf
    energy = late = 0.0
    ways, wishes = (values.reshape(len(values), -1).tolist() for values in (positions, limited))
    held = earlier = [0.0] * len(ways[0])
    forces = []
    last = ways[0]
    for position, force in zip(ways, wishes, strict=True):
        if forces:
            moved = [(now - before) * unit.position for now, before in zip(position, last, strict=True)]
            damped = _dot([guards.device_damping * part for part in moved], moved) / step
            work = [
                model.resistance * _dot([part * unit.force for part in shown], moved) + damped
                for shown in (held, earlier)
            ]
            energy = min(energy + work[0], guards.energy_reserve)
            late = energy if event_mode else min(late + work[1], guards.energy_reserve)
        if guards.rate_limit > 0:
            force = _near(force, held, guards.rate_limit * step)
        if guards.passive:
            first = [part * unit.force for part in held]
            at_hand = energy if event_mode else min(energy, late - _dot(first, first) * worst)
            largest = math.sqrt(at_hand / worst) / unit.force if at_hand > 0 else 0.0
            force = _near(force, [0.0] * len(force), largest)
        earlier, held, last = held, force, position
        forces.append(force)
    read = forces if event_mode else [[0.0] * len(held), *forces[:-1]]
    return np.array(read).reshape(limited.shape)


def _dot(one: list[float], other: list[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _near(wanted: list[float], centre: list[float], most: float) -> list[float]:
    """Return the wanted force, or the farthest allowed one in its direction."""
    if len(wanted) == 1:
        low, high = (centre[0] - most, centre[0] + most) if centre[0] else (-most, most)
        return [low if wanted[0] < low else high if wanted[0] > high else wanted[0]]
    away = [a - b for a, b in zip(wanted, centre, strict=True)]
    length = math.hypot(*away)
    if length <= most:
        return wanted
    return [b + a / length * most for a, b in zip(away, centre, strict=True)]


def shortened(vectors: np.ndarray, most: float) -> np.ndarray:
    """Forces within a limit, shape (samples,); in space, (samples, axes), none longer, each in its direction."""
    if vectors.ndim == 1:
        return np.clip(vectors, -most, most)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > most, vectors / np.where(length > most, length, 1.0) * most, vectors)
