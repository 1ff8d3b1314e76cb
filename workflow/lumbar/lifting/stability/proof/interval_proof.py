"""Proof that a funnel holds at every moment, not only at its knots: interval branch-and-bound, true sine.

What is proved is stated in interpolants, cubic splines through the knots (not-a-knot): of the reference θ0, of
the feedback gains K1, K2 and of the three numbers that describe the ellipse, with ρ in them,

    e = A·cos φ,   ω = P·cos φ + Q·sin φ.

With x̄ = N(t)·z the boundary is |z| = 1, and states stay inside where g = ½·d|z|²/dt < 0 on it for all φ and t:

    g = q11·cos²φ + q12·cos φ·sin φ + q22·sin²φ − (G/Q)·sin φ·(sin(θ0 + A·cos φ) − sin θ0)
    q11 = W = (P − Ȧ)/A,   q12 = Q/A − (k1·A + k2·P + Ṗ + P·W)/Q,   q22 = −k2 − Q̇/Q − P/A

with k1 = K1/I, k2 = (b + K2)/I, G = σmgℓ/I. Torque limits and an uncertain mass (`saturation`) add to g, for both
extreme masses,

    (1/Q)·sin φ·(r·y − x),   x = θ̈0 + G·sin θ0 − k1·e − k2·ω,   y = clip(x + d, ±U/I) − d,   d = (b/I)·(θ̇0 + ω)

Time is cut into pieces and the circle into arcs; on each box g is bounded by the mean-value form in interval
arithmetic (`interval_bounds`). Arcs that are not proved are halved, pieces of time with an arc that resists are
halved too; what resists to the end is not proved, and its share is reported.
"""

from __future__ import annotations

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.funnel import ClosedLoops, Funnels
from lumbar.lifting.stability.funnel.invariance import normal_axes
from lumbar.lifting.stability.funnel.saturation import UNSATURATED, Saturation
from lumbar.lifting.stability.proof.interval_bounds import Interpolants, IntervalBounds

ARCS = 24
"""Arcs of the circle to begin with."""
ARC_HALVINGS = 9
TIME_HALVINGS = 3
BOXES_AT_ONCE = 200_000


def interpolants(loops: ClosedLoops, funnels: Funnels, saturation: Saturation = UNSATURATED) -> Interpolants:
    """Return the stated interpolants through the funnel's knots.

    Raises
    ------
    NumericalError
        The funnel has fewer than four knots, or they do not lie among those of `loops`.
    """
    from scipy.interpolate import CubicSpline

    knots = len(funnels.level)
    stride, rest = divmod(loops.knots - 1, knots - 1)
    if knots < 4 or rest:
        raise NumericalError(f"{knots} knots do not lie evenly among {loops.knots}, or are fewer than four")
    pendulums, points = loops.pendulums, slice(None, None, 2 * stride)
    root = np.sqrt(funnels.level)
    a, p, q = (root * axis for axis in normal_axes(funnels.cost))
    curves = {
        "angle": pendulums.angle[points],
        "k1": loops.gains[points][..., 0] / pendulums.inertia,
        "k2": (pendulums.damping + loops.gains[points][..., 1]) / pendulums.inertia,
        "A": a,
        "P": p,
        "Q": q,
    }
    step = pendulums.duration / (knots - 1)
    # On the unit interval the splines of all pendulums are one call; then t is scaled to seconds.
    scale = step[None, :] ** np.arange(3, -1, -1)[:, None]
    pieces = {
        name: CubicSpline(np.arange(knots), values).c / scale[:, None, :] for name, values in curves.items()
    }
    return Interpolants(
        pieces,
        step,
        gravity=pendulums.gravity_torque / pendulums.inertia,
        drag=pendulums.damping / pendulums.inertia,
        torque=saturation.torque / pendulums.inertia,
        bias=saturation.bias / pendulums.inertia,
        ratios=saturation.ratios if saturation.active else (),
    )


def proved_share(loops: ClosedLoops, funnels: Funnels, saturation: Saturation = UNSATURATED) -> np.ndarray:
    """Return the share of the time axis on which the funnel is proved invariant, shape (pendulums,).

    The funnel must have a margin (`funnel.funnel_variants`): the exact one touches g = 0 at all times and no
    finite precision can prove that.
    """
    curves = interpolants(loops, funnels, saturation)
    intervals, count = next(iter(curves.pieces.values())).shape[1:]
    index = np.arange(intervals * count)
    middle = np.full(len(index), 0.5)
    proved = np.zeros(count)
    for halving in range(TIME_HALVINGS + 1):
        width = 0.5**halving
        holds = _prove(curves, index, middle, width)
        proved += width * np.bincount(index[holds] % count, minlength=count)
        index, middle = index[~holds], middle[~holds]
        middle = np.concatenate([middle - width / 4, middle + width / 4])
        index = np.concatenate([index, index])
    return proved / intervals


def _prove(curves: Interpolants, index: np.ndarray, middle: np.ndarray, width: float) -> np.ndarray:
    """Whether each piece of time is proved; `middle` and `width` in parts of its knot interval."""
    holds = np.zeros(len(index), dtype=bool)
    chunk = BOXES_AT_ONCE // ARCS
    for start in range(0, len(index), chunk):
        part = slice(start, start + chunk)
        holds[part] = _prove_arcs(IntervalBounds(curves, index[part], middle[part], width))
    return holds


def _prove_arcs(pieces: IntervalBounds) -> np.ndarray:
    holds = np.ones(pieces.size, dtype=bool)
    radius = np.pi / ARCS
    arcs = np.tile(2 * radius * np.arange(ARCS), pieces.size)
    piece = np.repeat(np.arange(pieces.size), ARCS)
    for _ in range(ARC_HALVINGS + 1):
        centre, bound = pieces.bounds(piece, arcs, radius)
        # A centre that is certainly outside, and the piece is lost whatever else is shown.
        holds[piece[centre > 0]] = False
        left = (bound >= 0) & holds[piece]
        piece, arcs = piece[left], arcs[left]
        if not len(piece):
            return holds
        radius /= 2
        piece = np.concatenate([piece, piece])
        arcs = np.concatenate([arcs - radius, arcs + radius])
    holds[piece] = False
    return holds
