"""A better V: the largest basin among Lyapunov functions of the same loop and the same goal set.

The controller stays; V need not be its cost. For every share λ in [0, 1] the Lyapunov equation

    −Ṡ = A_cᵀS + SA_c + λ·(Q + KᵀRK),   S(T) = Qf

gives a V = x̄ᵀSx̄. λ = 1 is the Riccati solution, the thesis's V. λ = 0 makes every ellipse the exact preimage of
the goal set under the linear loop: without gravity's nonlinearity no funnel is larger (Liouville). With it the
best share lies between, and the exact method finds the largest funnel of each.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import ClosedLoops

RELATIVE_TOLERANCE = 1e-9


def with_lyapunov_function(loops: ClosedLoops, share: float | np.ndarray) -> ClosedLoops:
    """Return the same loops with the V of one λ, or each with its own.

    The loops given have the Riccati solution; `share` is λ, a number or of shape (pendulums,).

    Raises
    ------
    NumericalError
        The integration failed or S lost its definiteness.
    """
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    pendulums = loops.pendulums
    points, count = pendulums.angle.shape
    share = np.broadcast_to(share, count)
    phase = np.linspace(0.0, 1.0, points)
    curves = CubicSpline(
        phase, np.concatenate([pendulums.angle[..., None], loops.gains, loops.decay], axis=-1)
    )
    inertia, damping = pendulums.inertia, pendulums.damping

    def backward(remaining, flat):
        angle, k1, k2, *decay = np.moveaxis(curves(1.0 - remaining), -1, 0)
        s11, s12, s22 = flat.reshape(3, count)
        a21 = -(pendulums.gravity_torque * np.cos(angle) + k1) / inertia
        a22 = -(damping + k2) / inertia
        rate = np.stack([2 * s12 * a21, s11 + s12 * a22 + s22 * a21, 2 * (s12 + s22 * a22)])
        return (pendulums.duration * (rate + share * np.stack(decay))).ravel()

    solution = solve_ivp(
        backward,
        (0.0, 1.0),
        loops.cost[-1].T.ravel(),
        method="DOP853",
        t_eval=phase,
        rtol=RELATIVE_TOLERANCE,
        atol=RELATIVE_TOLERANCE * float(np.abs(loops.cost[-1]).max()),
    )
    if not solution.success:
        raise NumericalError(f"Lyapunov equation of {pendulums.labels[0]}: {solution.message}")
    cost = np.moveaxis(solution.y.reshape(3, count, points)[..., ::-1], (0, 1, 2), (2, 1, 0))
    lost = ~((cost[..., 0] > 0) & (cost[..., 0] * cost[..., 2] > cost[..., 1] ** 2))
    if lost.any():
        index = int(np.argwhere(lost)[-1][1])
        raise NumericalError(
            f"{pendulums.labels[index]}: the Lyapunov function of share {share[index]:g} is indefinite",
            label=pendulums.labels[index],
        )
    return replace(loops, cost=cost, decay=share[:, None] * loops.decay)


def best_of_family(
    loops: ClosedLoops,
    terminal_level: float,
    shares: Sequence[float],
) -> Funnels:
    """Return the exact funnels of the largest average cross-section of each pendulum in the family.

    Parameters
    ----------
    loops : ClosedLoops
        With the Riccati solution.
    terminal_level : float
        ρ(T).
    shares : sequence of float
        λ to try.
    """
    count = len(loops.pendulums.labels)
    every = loops.select(np.tile(np.arange(count), len(shares)))
    members = with_lyapunov_function(every, np.repeat(shares, count))
    found = exact_funnels(members, terminal_level)
    largest = found.mean_area.reshape(len(shares), count).argmax(axis=0)
    return replace(found.select(largest * count + np.arange(count)), method="best of family")
