"""What repeated trials of one person tell: which measure separates the perturbed ones.

Each trial gives one number per measure, taken over the movement once the body has left its seat. The question is not that of a
push: the trials were perturbed while they were measured, and nobody stepped or fell. With n and m trials the exact test of
Mann and Whitney can at best reach p = 2/(n+m choose n).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lumbar.lifting.measures.balance import FUNCTIONAL_SHARE, pendulum_rate
from lumbar.lifting.movement.centre_of_mass import FOOT_SHARE, SHANK, THIGH
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.pushes.body import GRAVITY
from lumbar.lifting.pushes.roc import area
from lumbar.lifting.stability.comparison.perturbed_trials import cleaned_trial
from lumbar.records.markers import MarkerRecording
from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.pushes import PerturbationsSettings
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
