"""Which measure tells perturbed trials of one person from unperturbed ones.

Each trial gives one number per measure, taken over the movement once the body has left its seat. The question is not that of a
push: the trials were perturbed while they were measured, and nobody stepped or fell. With n and m trials the exact test of
Mann and Whitney can at best reach p = 2/(n+m choose n).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.measures.base_of_support import FUNCTIONAL_SHARE
from lumbar.lifting.measures.extrapolated_centre import pendulum_rate
from lumbar.lifting.movement.cleaning import derivative
from lumbar.lifting.pushes.motion import SHANK, THIGH
from lumbar.lifting.pushes.roc import areas, ordered
from lumbar.lifting.stability.comparison.perturbed_trials import cleaned_trial
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.records.markers import MarkerRecording
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.perturbations import PerturbationsSettings

FEET_SHARE = 0.029
"""Mass of both feet as a share of the body's (Winter, 2009, Table 4.1)."""
RISEN = 0.1
"""The seat is left where the pelvis has risen by this share of its whole way."""
GRAVITY = 9.81
MEASURES = {
    "margin_forward": "smallest distance in m of the extrapolated centre of mass to the toes' end of the functional base (Hof)",
    "margin_backward": "smallest distance in m to its heels' end",
    "smallest_impulse_forward": "m·ω0 times the first, in N·s",
    "trunk_inclination": "largest inclination of the trunk in °",
    "hip_moment": "largest net moment in N·m of trunk, head and arms about the pelvis",
    "basin": "largest V/ρ in the exact basin of the mean of the other unperturbed trials (inverted, the study's regulator): "
    "a distance from the unperturbed movement by its definition",
    "duration": "length of the recording in s",
}
COLUMNS = {
    "measure": "; ".join(f"{name}: {meaning}" for name, meaning in MEASURES.items()),
    "unperturbed": "values of the unperturbed trials",
    "perturbed": "values of the perturbed trials",
    "auc": "share of pairs, one trial of each group, in which the perturbed one has the larger value: 0 and 1 separate the "
    "groups, 0.5 does not",
    "p_exact": "two-sided exact p of Mann and Whitney",
    "p_holm": "the same after Holm's correction over the measures",
}


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
    """Return the movement of one recording.

    Parameters
    ----------
    recording : MarkerRecording
        With the markers of ``settings.pivot``, ``top`` and ``legs``.
    settings : PerturbationsSettings
        With ``legs``.
    lifting : LiftingSettings
        Gaps and filter.

    Raises
    ------
    InputError
        One of these markers is missing or has a gap that cannot be filled.
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
        (THIGH[0], pelvis + THIGH[1] * (knee - pelvis)),
        (SHANK[0], knee + SHANK[1] * (ankle - knee)),
        (FEET_SHARE, (heel + toe) / 2),
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


def values_of(trial: BodyTrial, settings: PerturbationsSettings) -> dict[str, float]:
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
    """Compare the groups by every measure.

    Parameters
    ----------
    found : list of dict of str to float
        Measures of every trial by name; what one trial has, all have.
    groups : list of str
        ``"unperturbed"`` or ``"perturbed"``, one per trial.

    Returns
    -------
    pandas.DataFrame
        Columns `COLUMNS`; the smallest p first.
    """
    import pandas as pd
    from scipy.stats import mannwhitneyu

    perturbed = np.array(groups) == "perturbed"
    rows = []
    for name in [name for name in MEASURES if name in found[0]]:
        values = np.array([item[name] for item in found])
        scores = ordered(values, perturbed, np.zeros(len(values), dtype=int))
        rows.append(
            {
                "measure": name,
                "unperturbed": ", ".join(f"{value:.3g}" for value in sorted(values[~perturbed])),
                "perturbed": ", ".join(f"{value:.3g}" for value in sorted(values[perturbed])),
                "auc": float(areas(scores, np.ones((1, 1), dtype=int))[0]),
                "p_exact": float(mannwhitneyu(values[perturbed], values[~perturbed], method="exact").pvalue),
            }
        )
    frame = pd.DataFrame(rows).sort_values("p_exact", kind="stable", ignore_index=True)
    steps = frame["p_exact"].to_numpy() * np.arange(len(frame), 0, -1)
    frame["p_holm"] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return frame[list(COLUMNS)]


def separation_table(frame: pd.DataFrame, groups: list[str], data: str, feedback: str = "") -> Table:
    """Return the comparison as a published table that says what one person can and cannot show; `feedback` is one note more."""
    apart = [row.measure for row in frame.itertuples() if row.auc in (0.0, 1.0)]
    said = (
        f"{', '.join(apart)} separate{'s' if len(apart) == 1 else ''} all trials"
        if apart
        else "No measure separates all trials"
    )
    notes = (
        f"{said} ({groups.count('unperturbed')} unperturbed, {groups.count('perturbed')} perturbed, one person)",
        "What this can show: that the perturbation changed the movement, and in which measure. What it cannot: that a measure "
        "foretells a step or a fall (the trials were perturbed while they were measured, and no step is known of), or that it "
        "would do so of anyone else",
        "Body mass is assumed, both legs are taken to move as the marked one, and the centre of mass is that of trunk with head "
        "and arms, thighs, shanks and feet (Winter 2009, Table 4.1)",
        *([feedback] if feedback else []),
    )
    return Table(
        title="Perturbed and unperturbed trials told apart, measure by measure.",
        frame=frame,
        definitions=COLUMNS,
        data=data,
        notes=notes,
        decimals=dict.fromkeys(("auc", "p_exact", "p_holm"), 3),
    )
