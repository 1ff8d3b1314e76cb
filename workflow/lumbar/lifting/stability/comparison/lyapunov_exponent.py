"""Maximum Lyapunov exponent of repeated movements, by divergence of nearest neighbours.

Rosenstein, Collins & De Luca, Physica D 65 (1993) 117–134: the logarithm of the distance between a state and its
nearest neighbour in another trial grows along a line whose slope is the exponent. As usual for movements that
repeat (England & Granata, Gait & Posture 25 (2007) 172–178), states are scaled to unit variance.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.stability.model.trajectories import COMS, Trajectory

FEWEST_TRIALS = 30
"""Repetitions below which the exponent's own scatter exceeds what it should tell apart (Bruijn et al., Journal of
Neuroscience Methods 178 (2009) 327–333, ask for many more)."""

HORIZON_SHARE = 0.25
"""Share of the shortest movement over which divergence is followed."""


@dataclass(frozen=True)
class Exponent:
    """Result of `maximum_exponent`."""

    value: float | None
    """In 1/s; None with insufficient data."""
    remark: str
    """``"estimated from N trials"`` or ``"insufficient data: …"``."""


def maximum_exponent(
    trials: list[np.ndarray], step: float, horizon: float, fewest: int = FEWEST_TRIALS
) -> Exponent:
    """Estimate the exponent from trials.

    Parameters
    ----------
    trials : list of numpy.ndarray, shape (samples, states)
        At the same sampling; rows in time.
    step : float
        Seconds between samples.
    horizon : float
        Seconds over which divergence is followed.
    fewest : int
        Trials below which there is no estimate.

    Raises
    ------
    InputError
        Trials shorter than twice the horizon.
    """
    from scipy.spatial import cKDTree

    if len(trials) < fewest:
        count = f"{len(trials)} trial{'' if len(trials) == 1 else 's'}"
        return Exponent(None, f"insufficient data: {count}, at least {fewest} are needed")
    ahead = round(horizon / step)
    shortest = min(len(trial) for trial in trials)
    if shortest < 2 * ahead:
        raise InputError(
            f"trial of {shortest * step:g} s; at least twice the horizon of {horizon:g} s is needed"
        )
    scale = np.concatenate(trials).std(axis=0)
    scaled = [trial / scale for trial in trials]
    divergence = []
    for index, trial in enumerate(scaled):
        others = [item for other, item in enumerate(scaled) if other != index]
        starts = np.concatenate([item[: len(item) - ahead] for item in others])
        owner = np.concatenate([np.full(len(item) - ahead, number) for number, item in enumerate(others)])
        place = np.concatenate([np.arange(len(item) - ahead) for item in others])
        _, nearest = cKDTree(starts).query(trial[: len(trial) - ahead])
        for row, neighbour in enumerate(nearest):
            other, at = others[owner[neighbour]], place[neighbour]
            distance = np.linalg.norm(trial[row : row + ahead] - other[at : at + ahead], axis=1)
            if (distance > 0).all():
                divergence.append(np.log(distance))
    if not divergence:
        raise InputError("every state has an identical neighbour in another trial: the trials are copies")
    mean = np.mean(divergence, axis=0)
    slope = np.polyfit(step * np.arange(ahead), mean, 1)[0]
    return Exponent(float(slope), f"estimated from {len(trials)} trials")


def movement_exponent(movements: list[Trajectory]) -> Exponent:
    """Estimate the exponent of repeated movements from their angles and angular velocities.

    The movements are of one COM and plane; each is brought to the sampling of the slowest sampled one, in real time.
    """
    if len(movements) < FEWEST_TRIALS:
        return maximum_exponent([np.zeros((0, 2))] * len(movements), 1.0, 1.0)
    step = max(item.duration / (len(item.time) - 1) for item in movements)
    trials = []
    for item in movements:
        time = item.time[0] + step * np.arange(int(item.duration / step * (1 + 1e-9)) + 1)
        states = [np.interp(time, item.time, values) for values in (item.angle, item.angular_velocity)]
        trials.append(np.stack(states, axis=1))
    return maximum_exponent(trials, step, HORIZON_SHARE * min(item.duration for item in movements))


def compared_exponents(
    trajectories: list[Trajectory], plane: str, comparisons: Iterable[tuple]
) -> dict[tuple[str, str], str]:
    """Return what stands beside the basins of one plane: exponents before and after, or that data are insufficient.

    They are given by comparison and COM, from all trajectories of the study; comparisons are as
    `percent_differences.comparisons` yields them.
    """
    result = {}
    for name, *sides, status in comparisons:
        for com in COMS:
            if status != "computed":
                result[name, com] = status
                continue
            found = []
            for experience, mass in sides:
                lift = (experience, mass, com, plane)
                exponent = movement_exponent(
                    [
                        item
                        for item in trajectories
                        if (item.experience, item.box_mass_kg, item.com, item.plane) == lift
                    ]
                )
                value = "" if exponent.value is None else f"{exponent.value:.3g} 1/s, "
                found.append(f"{experience} {mass:g} kg: {value}{exponent.remark}")
            result[name, com] = "; ".join(found)
    return result
