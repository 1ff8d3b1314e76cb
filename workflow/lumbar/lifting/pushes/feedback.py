"""A person's own feedback from repeated trials, and the basin that belongs to it instead of to an assumed regulator.

Around their mean movement the trials deviate by e and ω at equal phase. With the pendulum of Eq. 4.1,

    −(I·α + b·ω + σmgℓ·(sin(θ0 + e) − sin θ0)) = K1(t)·e + K2(t)·ω − disturbance,

so that K follows by least squares with a low order in time. The disturbance must change faster than the states, or it is
mistaken for feedback; noise in the states makes the gains too small. Intervals leave out one trial after the other (jackknife)
and are Student's with trials − 1 degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.stability.comparison.perturbed_trials import PHASE_POINTS, Trial, mean_trajectory
from lumbar.lifting.stability.funnel.funnel import ClosedLoops, exact_funnels
from lumbar.lifting.stability.funnel.lyapunov_family import with_lyapunov_function
from lumbar.lifting.stability.model.pendulum_loop import Pendulums, gather
from lumbar.lifting.stability.model.riccati import Weights

if TYPE_CHECKING:
    from lumbar.settings.perturbations import PerturbationsSettings
    from lumbar.settings.stability import StabilitySettings

FEWEST_TRIALS = 4
COVERAGE = 0.95


@dataclass(frozen=True)
class Feedback:
    """Gains over phase."""

    phase: np.ndarray
    """Shape (points,): from 0 to 1."""
    gains: np.ndarray
    """Shape (points, 2): K1 in N·m/rad and K2 in N·m·s/rad."""
    left_out: np.ndarray
    """Shape (trials, points, 2): the same without each of the trials."""

    @property
    def interval(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of the pointwise 95 % interval, shape (points, 2) each."""
        return jackknife_interval(self.gains, self.left_out)


def jackknife_interval(value: np.ndarray, left_out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Student's interval of an estimate from those without each trial, shape (trials, ...)."""
    from scipy.stats import t

    count = len(left_out)
    error = np.sqrt((count - 1) / count * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0))
    half = t.ppf(0.5 + COVERAGE / 2, count - 1) * error
    return value - half, value + half


def estimate_feedback(
    pendulum: Pendulums, error: np.ndarray, rate: np.ndarray, acceleration: np.ndarray, order: int = 1
) -> Feedback:
    """Estimate K1(t) and K2(t) from deviations of trials about their mean.

    Parameters
    ----------
    pendulum : Pendulums
        One; its angle at `points` even phases is the mean movement.
    error, rate, acceleration : numpy.ndarray, shape (trials, points)
        Deviations of angle, angular velocity and angular acceleration in rad, rad/s and rad/s².
    order : int
        Of the polynomials in phase.

    Raises
    ------
    InputError
        Fewer than `FEWEST_TRIALS` trials.
    """
    if len(error) < FEWEST_TRIALS:
        raise InputError(
            f"feedback: {len(error)} trials; at least {FEWEST_TRIALS} are needed to estimate gains and their intervals"
        )
    mean = pendulum.angle[:, 0]
    torque = -(
        pendulum.inertia[0] * acceleration
        + pendulum.damping[0] * rate
        + pendulum.gravity_torque[0] * (np.sin(mean + error) - np.sin(mean))
    )
    phase = np.linspace(0.0, 1.0, error.shape[1])
    basis = np.polynomial.legendre.legvander(2 * phase - 1, order)
    # Trial by trial the normal equations, so that leaving one out is a subtraction.
    columns = np.concatenate([error[..., None] * basis, rate[..., None] * basis], axis=-1)
    squares = np.einsum("tpi,tpj->tij", columns, columns)
    products = np.einsum("tpi,tp->ti", columns, torque)

    def gains(matrix, vector) -> np.ndarray:
        coefficients = np.linalg.solve(matrix, vector[..., None])[..., 0]
        both = coefficients.reshape(*coefficients.shape[:-1], 2, order + 1)
        return np.einsum("...ki,pi->...pk", both, basis)

    whole = squares.sum(axis=0), products.sum(axis=0)
    return Feedback(phase, gains(*whole), gains(whole[0] - squares, whole[1] - products))


def basin_of_feedback(pendulum: Pendulums, gains: np.ndarray, weights: Weights, goal_level: float) -> float:
    """Return the average cross-section in rad²/s of the exact basin under given gains.

    V is the cost of these gains under the study's weights, −Ṡ = A_cᵀS + SA_c + Q + KᵀRK, S(T) = Qf.

    Parameters
    ----------
    pendulum : Pendulums
        One, with its angle at `points` even phases.
    gains : numpy.ndarray, shape (points, 2)
    goal_level : float
        ρ(T).

    Raises
    ------
    NumericalError
        The basin cannot be computed.
    """
    k1, k2 = gains.T
    feedback = np.stack([k1**2, k1 * k2, k2**2], axis=-1)
    decay = weights.state + np.asarray(weights.control)[..., None] * feedback
    goal = np.broadcast_to(weights.terminal, (len(gains), 1, 3))
    loops = ClosedLoops(pendulum, weights, goal, decay[:, None], gains[:, None])
    return float(exact_funnels(with_lyapunov_function(loops, 1.0), goal_level).mean_area[0])


def basin_of_person(
    pendulum: Pendulums, feedback: Feedback, weights: Weights, goal_level: float
) -> tuple[float, float, float]:
    """Return area and 95 % interval of the basin of a person's own feedback, from the basins without each trial.

    The interval is that of the logarithm of the area.
    """
    area = basin_of_feedback(pendulum, feedback.gains, weights, goal_level)
    others = [basin_of_feedback(pendulum, gains, weights, goal_level) for gains in feedback.left_out]
    low, high = jackknife_interval(np.log(area), np.log(others))
    return area, float(np.exp(low)), float(np.exp(high))


def feedback_sentence(
    trials: list[Trial], settings: PerturbationsSettings, stability: StabilitySettings
) -> str:
    """Say what the trials of a person tell of the feedback at half the movement, with gravity as on a standing person.

    Deviations are those from the mean of the unperturbed trials; accelerations are derivatives of splines.
    """
    quiet = [item for item in trials if item.group == "unperturbed"]
    parts = []
    for name, chosen in (("unperturbed", quiet), ("all", trials)):
        low, high = (
            end[PHASE_POINTS // 2] for end in _feedback_of(chosen, quiet, settings, stability).interval
        )
        parts.append(
            f"K1 {low[0]:.0f} to {high[0]:.0f} N·m/rad and K2 {low[1]:.0f} to {high[1]:.0f} N·m·s/rad from {name} ({len(chosen)} "
            "trials)"
        )
    return (
        f"What would be the person's own feedback at half the movement (inverted pendulum, 95 %, jackknife over trials): "
        f"{'; '.join(parts)}. The deviations hold differences of tempo and the perturbations, whose forces were not recorded: no "
        "basin is made of these gains, and the regulator stays assumed"
    )


def _feedback_of(trials, quiet, settings: PerturbationsSettings, stability: StabilitySettings) -> Feedback:
    from scipy.interpolate import CubicSpline

    mean, pendulum = mean_trajectory(quiet, settings), stability.pendulum
    knots = (PHASE_POINTS + 1) // 2
    loop = gather([mean], ["inverted"], [pendulum.damping_N_m_s], pendulum.gravity_m_s2, knots)
    phase = np.linspace(0.0, 1.0, PHASE_POINTS)
    acceleration = [
        CubicSpline(phase * item.duration, item.angular_velocity)(phase * item.duration, 1) for item in trials
    ]
    return estimate_feedback(
        loop,
        np.array([item.angle for item in trials]) - mean.angle,
        np.array([item.angular_velocity for item in trials]) - mean.angular_velocity,
        np.array(acceleration) - mean.angular_acceleration,
    )
