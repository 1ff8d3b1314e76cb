"""What repeated trials of one person tell: which measure separates the perturbed ones, and the person's own feedback.

Each trial gives one number per measure, taken over the movement once the body has left its seat. The question is not that of a
push: the trials were perturbed while they were measured, and nobody stepped or fell. With n and m trials the exact test of
Mann and Whitney can at best reach p = 2/(n+m choose n).

Around their mean movement the trials deviate by e and ω at equal phase. With the pendulum of Eq. 4.1,

    −(I·α + b·ω + σmgℓ·(sin(θ0 + e) − sin θ0)) = K1(t)·e + K2(t)·ω − disturbance,

so that K follows by least squares with a low order in time. The disturbance must change faster than the states, or it is
mistaken for feedback; noise in the states makes the gains too small. Intervals leave out one trial after the other (jackknife)
and are Student's with trials − 1 degrees of freedom.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.measures.balance import FUNCTIONAL_SHARE, pendulum_rate
from lumbar.lifting.movement.centre_of_mass import FOOT_SHARE, SHANK, THIGH
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.pushes.body import GRAVITY
from lumbar.lifting.pushes.roc import area, jackknife_interval
from lumbar.lifting.stability.comparison.perturbed_trials import (
    PHASE_POINTS,
    Trial,
    cleaned_trial,
    mean_trajectory,
)
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums, gather
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.pushes import PerturbationsSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

RISEN = 0.1
"""The seat is left where the pelvis has risen by this share of its whole way."""
MEASURES = (
    *("margin_forward", "margin_backward", "smallest_impulse_forward", "trunk_inclination", "hip_moment"),
    *("basin", "duration"),
)


@dataclass(frozen=True)
class BodyTrial:
    """Sagittal movement of one trial after the seat is left; forward and up from the ankles, shape (n, 2) in m."""

    name: str
    group: str
    rate: float
    """Frames per second."""
    centre: np.ndarray
    """Shape (n, 2): of the whole body."""
    trunk: np.ndarray
    """Shape (n, 2): from the pelvis to the centre of trunk, head and arms."""
    heel: float
    toe: float
    """`heel`, `toe`: ends of the foot ahead of the ankles, m."""
    ankle_height: float
    duration: float
    """Of the recording, s."""


def body_trial(
    recording: MarkerRecording, group: str, settings: PerturbationsSettings, lifting: LiftingSettings
) -> BodyTrial:
    """Return the movement of one recording; the settings name markers of the legs.

    Raises
    ------
    InputError
        A marker that the settings name is missing or has a gap that cannot be filled.
    """
    legs = settings.legs
    feet = (*legs.knee, *legs.ankle, *legs.heel, *legs.toe)
    smooth = cleaned_trial(recording, (*settings.pivot, *settings.top, *feet), lifting)

    def middle(names: tuple[str, ...]) -> np.ndarray:
        return np.mean([smooth[name] for name in names], axis=0)[:, 1:]

    pelvis, top, knee, ankle = (
        middle(names) for names in (settings.pivot, settings.top, legs.knee, legs.ankle)
    )
    heel, toe = middle(legs.heel), middle(legs.toe)
    trunk = settings.centre_share * (top - pelvis)
    parts = [
        (settings.mass_share, pelvis + trunk),
        (2 * THIGH.mass, pelvis + THIGH.centre * (knee - pelvis)),
        (2 * SHANK.mass, knee + SHANK.centre * (ankle - knee)),
        (2 * FOOT_SHARE, (heel + toe) / 2),
    ]
    centre = sum(share * place for share, place in parts) / sum(share for share, _ in parts)
    height = pelvis[:, 1]
    left = int(np.argmax(height > height.min() + RISEN * np.ptp(height)))
    return BodyTrial(
        recording.name,
        group,
        recording.rate,
        (centre - ankle)[left:],
        trunk[left:],
        float((heel - ankle)[left:, 0].mean()),
        float((toe - ankle)[left:, 0].mean()),
        float(ankle[left:, 1].mean() - min(heel[left:, 1].mean(), toe[left:, 1].mean())),
        float(recording.time[-1] - recording.time[0]),
    )


def measures_of_trial(trial: BodyTrial, settings: PerturbationsSettings) -> dict[str, float]:
    """Return the measures of one trial by name, without those of basins."""
    body_mass, trunk_mass = settings.body_mass_kg, settings.mass_share * settings.body_mass_kg
    relative = trial.centre + np.array([0.0, trial.ankle_height])
    omega = pendulum_rate(np.linalg.norm(relative, axis=1), GRAVITY)
    point = relative[:, 0] + derivative(trial.centre, trial.rate)[:, 0] / omega
    middle, half = (trial.heel + trial.toe) / 2, FUNCTIONAL_SHARE * (trial.toe - trial.heel) / 2
    forward, backward = middle + half - point, point - (middle - half)
    acceleration = derivative(trial.trunk, trial.rate, 2)
    x, z = trial.trunk.T
    moment = trunk_mass * (x * (acceleration[:, 1] + GRAVITY) - z * acceleration[:, 0])
    return {
        "margin_forward": float(forward.min()),
        "margin_backward": float(backward.min()),
        "smallest_impulse_forward": float((body_mass * omega * forward).min()),
        "trunk_inclination": float(np.degrees(np.arctan2(x, z)).max()),
        "hip_moment": float(np.abs(moment).max()),
        "duration": trial.duration,
    }


def separation_frame(found: list[dict[str, float]], groups: list[str]) -> pd.DataFrame:
    """Compare the groups by every measure; the smallest p first.

    There are measures by name and ``"unperturbed"`` or ``"perturbed"`` for every trial; what one trial has, all have.
    """
    from scipy.stats import mannwhitneyu

    perturbed = np.array(groups) == "perturbed"
    rows = []
    for name in [name for name in MEASURES if name in found[0]]:
        values = np.array([item[name] for item in found])
        rows.append(
            {
                "measure": name,
                "unperturbed": ", ".join(f"{value:.3g}" for value in sorted(values[~perturbed])),
                "perturbed": ", ".join(f"{value:.3g}" for value in sorted(values[perturbed])),
                "auc": area(values, perturbed),
                "p_exact": float(mannwhitneyu(values[perturbed], values[~perturbed], method="exact").pvalue),
            }
        )
    frame = pd.DataFrame(rows).sort_values("p_exact", kind="stable", ignore_index=True)
    steps = frame["p_exact"].to_numpy() * np.arange(len(frame), 0, -1)
    frame["p_holm"] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return frame[columns_of(__file__, "trial_separation")]


def separation_table(frame: pd.DataFrame, groups: list[str], data: str, feedback: str = "") -> Table:
    """Return the comparison as a published table that says what one person can and cannot show; `feedback` is one note more."""
    apart = [row.measure for row in frame.itertuples() if row.auc in (0.0, 1.0)]
    them = f"{', '.join(apart)} separate{'s' if len(apart) == 1 else ''}" if apart else "No measure separates"
    counts = {group: groups.count(group) for group in ("unperturbed", "perturbed")}
    notes = [feedback] if feedback else []
    return described(__file__, "trial_separation", frame, data, {"apart": them, **counts}, notes=notes)


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
