"""Passivity of a sampled virtual environment: the damping that a device needs.

J. E. Colgate and G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, Journal
of Robotic Systems 14 (1997) 37–47: a device with damping b behind a hold of the force of H(z) is passive if and only if

    b > T/2 · 1/(1 − cos ωT) · Re{(1 − exp(−jωT)) H(exp(jωT))}   for 0 ≤ ω ≤ π/T.

If forces are late, or ticks repeat only after several, the condition concerns all pieces of a period in which one force acts.
While the device moves by u within s seconds the force f takes in f u, and a damping b at least b u²/s, which it takes in at an
even speed (Cauchy and Schwarz). With f = F(exp(jθ)) u over the pieces no energy is given out in the long run, whatever the hand
does, if and only if F + Fᴴ + 2b diag(1/s) ≥ 0 for every θ; with one piece this is the condition above.
"""

import numpy as np

from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles
from lumbar.tissue.haptics.ticks import PeriodicModel, in_ticks

_REFINED, _FEWEST = 101, 12
_NEAR = np.sinh(np.linspace(-4.0, 4.0, 33))
"""Angles near a pole, in multiples of its distance to the unit circle."""


def damping_at(model: SampledModel | PeriodicModel, angles: np.ndarray) -> np.ndarray:
    """Return the damping in N·s/m that the condition requires at every angle θ in (0, π] over a period; shape (angles,)."""
    moves, seconds = by_moves(model, angles)
    weighted = np.sqrt(np.outer(seconds, seconds)) * (moves + moves.conj().swapaxes(1, 2))
    return -np.linalg.eigvalsh(weighted)[:, 0] / 2.0


def by_moves(model: SampledModel | PeriodicModel, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return F at every angle, (angles, pieces, pieces), and the seconds of the pieces of a period in which one force acts."""
    model = in_ticks(model)
    ticks = len(model.intervals)
    pieces = [(tick, age, seconds) for tick, parts in enumerate(model.acting) for age, seconds in parts]
    tick, age, seconds = (np.array(values) for values in zip(*pieces, strict=True))
    ahead = np.exp(1j * angles)[:, None, None]
    periods, shown = np.divmod(tick - age, ticks)
    forces = model.response(angles)[:, shown] * ahead ** periods[:, None]
    # The position of a tick is the sum of all moves before it.
    return forces @ ((tick < np.arange(ticks)[:, None]) + 1.0 / (ahead - 1.0)), seconds


def required_damping(model: SampledModel | PeriodicModel, points: int = 2000) -> float:
    """Return the smallest damping in N·s/m with which the device is passive with a stable model in any passive hand.

    0 if the model needs none; infinite with a negative static stiffness, which gives out energy in the slowest motion, when a
    damping takes in nothing.

    Parameters
    ----------
    points : int
        Angles at which the condition is evaluated before the neighbourhood of the worst is refined.
    """
    if model.static_stiffness < 0:
        return float("inf")
    ticking = in_ticks(model)
    intervals = ticking.intervals
    # An angle over a period of several ticks covers one frequency per tick.
    angles = all_angles(max(points // len(intervals), _FEWEST))
    # Add angles near the poles, as dense as each resonance is narrow; `unique` keeps one of a conjugate pair.
    poles = ticking.model.poles ** sum(map(len, ticking.taken))
    near = np.unique(np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * _NEAR)
    angles = np.sort(np.concatenate([angles, near[(near > 0.0) & (near < np.pi)]]))
    worst = int(damping_at(model, angles).argmax())
    refined = max(_REFINED // len(intervals), _FEWEST)
    angles = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], refined)
    return max(0.0, float(damping_at(model, angles).max()))
