"""A person's own feedback, from repeated trials.

Around their mean movement the trials deviate by e and ω at equal phase. With the pendulum of Eq. 4.1,

    −(I·α + b·ω + σmgℓ·(sin(θ0 + e) − sin θ0)) = K1(t)·e + K2(t)·ω − disturbance,

so that K follows by least squares with a low order in time. The disturbance must change faster than the states, or it is
mistaken for feedback; noise in the states makes the gains too small. Intervals leave out one trial after the other (jackknife)
and are Student's with trials − 1 degrees of freedom.
"""

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.pushes.roc import jackknife_interval
from lumbar.lifting.stability.comparison.perturbed_trials import PHASE_POINTS, Trial, mean_trajectory
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, gather
from lumbar.settings.pushes import PerturbationsSettings
from lumbar.settings.stability import StabilitySettings

FEWEST_TRIALS = 4


def estimate_feedback(
    pendulum: Pendulums, error: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate K1(t) and K2(t), linear in phase, from deviations of trials about their mean.

    The angle of the one pendulum at `points` even phases is the mean movement; deviations of angle, angular velocity and
    angular acceleration have shape (trials, points). Returned are the ends of the pointwise 95 % interval, shape (points, 2)
    each, in N·m/rad and N·m·s/rad.
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
    basis = np.polynomial.legendre.legvander(2 * phase - 1, 1)
    # Trial by trial the normal equations, so that leaving one out is a subtraction.
    columns = np.concatenate([error[..., None] * basis, rate[..., None] * basis], axis=-1)
    squares = np.einsum("tpi,tpj->tij", columns, columns)
    products = np.einsum("tpi,tp->ti", columns, torque)

    def gains(matrix, vector) -> np.ndarray:
        coefficients = np.linalg.solve(matrix, vector[..., None])[..., 0]
        both = coefficients.reshape(*coefficients.shape[:-1], 2, 2)
        return np.einsum("...ki,pi->...pk", both, basis)

    whole = squares.sum(axis=0), products.sum(axis=0)
    return jackknife_interval(gains(*whole), gains(whole[0] - squares, whole[1] - products))


def feedback_sentence(
    trials: list[Trial], settings: PerturbationsSettings, stability: StabilitySettings
) -> str:
    """Say what the trials of a person tell of the feedback at half the movement, with gravity as on a standing person.

    Deviations are those from the mean of the unperturbed trials; accelerations are derivatives of splines.
    """
    quiet = [item for item in trials if item.group == "unperturbed"]
    parts = []
    for name, chosen in (("unperturbed", quiet), ("all", trials)):
        low, high = (end[PHASE_POINTS // 2] for end in _feedback_of(chosen, quiet, settings, stability))
        parts.append(
            f"K1 {low[0]:.0f} to {high[0]:.0f} N·m/rad and K2 {low[1]:.0f} to {high[1]:.0f} N·m·s/rad from {name} ({len(chosen)} "
            "trials)"
        )
    return (
        f"What would be the person's own feedback at half the movement (inverted pendulum, 95 %, jackknife over trials): "
        f"{'; '.join(parts)}. The deviations hold differences of tempo and the perturbations, whose forces were not recorded: no "
        "basin is made of these gains, and the regulator stays assumed"
    )


def _feedback_of(trials, quiet, settings: PerturbationsSettings, stability: StabilitySettings):
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
