"""The contest: random pushes against the simulated bodies of a study's lifts, and what every measure said before.

Two contests: pushes of all sizes, in which a measure may use the size; and pushes of one size per direction, which ask whether a
measure ranks people and postures. An instant at which the body would step without any push is no test of a push and is left
out; how many were is counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.errors import InputError
from lumbar.pushes.levels import BACKWARD, DIRECTIONS, FORWARD, PREDICTORS, Levels
from lumbar.pushes.motion import DepositMotion, bodies_of
from lumbar.pushes.person import Traits, draw_traits, persons_of
from lumbar.pushes.reference import references_of
from lumbar.pushes.roc import best_threshold
from lumbar.pushes.simulation import Pushes, Scene, simulate

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.pushes import PushesSettings

COLUMNS = {
    "subject": "who is pushed",
    "lift": "during which lift",
    "time_s": "when, on the clock of the lift",
    "direction": "forward or backward",
    "impulse_N_s": "size of the push in N·s, drawn at random",
    "outcome": "stands: back within the feet at the end; leans: a leg leant too far; unbalanced: not within the feet at the end",
    "steps": "whether the simulated person must step: leans or is unbalanced",
    "equal_impulse_N_s": "size in N·s of the push at the same instant in the contest of equal pushes",
    "equal_steps": "whether the person must step after that push",
    "shift_m_per_N_s": "1/(m·ω0): how far a push moves the extrapolated centre of mass",
    **{f"level_{name}": predictor.meaning for name, predictor in PREDICTORS.items()},
}
"""Columns of ``pushes.csv``: everything that the ROC is made of."""


@dataclass(frozen=True)
class Contest:
    """Pushes with their outcomes and levels.

    Attributes
    ----------
    frame : pandas.DataFrame
        One row per push; columns `COLUMNS`.
    drawn : int
        Pushes drawn.
    unsteady : int
        Those left out because the body would step without a push.
    """

    frame: pd.DataFrame
    drawn: int
    unsteady: int


def draw_pushes(motions: list[DepositMotion], scene: Scene, settings: PushesSettings, seed: int) -> Pushes:
    """Draw instants evenly likely within every deposit, directions in turn, and sizes evenly likely."""
    rng, push = np.random.default_rng([seed, 2]), settings.push
    lift = np.repeat(np.arange(len(motions)), push.per_lift)
    references = scene.references
    first, last = references.first[lift], references.last[lift]
    instant = first + (rng.random(lift.size) * (last - first)).astype(int)
    sign = np.where(np.arange(lift.size) % 2 == 0, 1.0, -1.0)
    share = rng.random(lift.size)
    low, high = (np.where(sign > 0, push.forward_N_s[k], push.backward_N_s[k]) for k in range(2))
    return Pushes(lift, instant, sign * (low + share * (high - low)))


def scene_of(motions: list[DepositMotion], settings: PushesSettings, traits: Traits) -> Scene:
    """Everything a simulation of some motions needs."""
    return Scene(
        bodies_of(motions),
        persons_of(motions, settings.body, settings.controller, traits),
        references_of(motions, settings.outcome.step_s / 2),
        settings.controller,
        settings.push,
        settings.outcome,
    )


def hold_contest(
    motions: list[DepositMotion],
    levels: list[Levels],
    settings: PushesSettings,
    seed: int,
    changed: Mapping[str, float] | None = None,
    every: int = 1,
    equal: bool = True,
) -> Contest:
    """Push the bodies of some lifts and put beside each push what the measures said before it.

    Parameters
    ----------
    motions : list of DepositMotion
    levels : list of Levels
        Of the same lifts.
    settings : PushesSettings
    seed : int
    changed : mapping of str to float, optional
        Factors on everybody's traits, by the attributes of `Traits`: what no measure is told.
    every : int
        Only every so many of the pushes are followed.
    equal : bool
        Whether equal pushes are simulated too; without them their columns repeat the others.

    Raises
    ------
    InputError
        All pushes end alike, or none is a test.
    """
    traits = draw_traits([item.subject for item in motions], settings.controller, settings.spread, seed)
    traits = replace(
        traits, **{name: factor * getattr(traits, name) for name, factor in (changed or {}).items()}
    )
    scene = scene_of(motions, settings, traits)
    drawn = draw_pushes(motions, scene, settings, seed)
    drawn = _some(drawn, np.arange(len(drawn.lift)) % every == 0)
    steady = ~simulate(scene, replace(drawn, impulse=0 * drawn.impulse)).steps
    pushes = _some(drawn, steady)
    ends = simulate(scene, pushes)
    if ends.steps.all() or not ends.steps.any():
        raise InputError(
            f"pushes: {ends.steps.sum()} of {len(ends.steps)} pushes make the bodies step, and {(~steady).sum()} would step "
            "without one; both outcomes are needed: change pushes.push.forward_N_s or backward_N_s"
        )
    sizes, again = pushes.impulse, ends
    if equal:
        sizes = _equal_sizes(pushes.impulse, ends.steps)
        again = simulate(scene, replace(pushes, impulse=sizes))
    frame = _frame(motions, levels, scene, pushes, ends, sizes, again.steps)
    return Contest(frame, len(steady), int((~steady).sum()))


def _some(pushes: Pushes, chosen: np.ndarray) -> Pushes:
    return Pushes(pushes.lift[chosen], pushes.instant[chosen], pushes.impulse[chosen])


def _equal_sizes(impulse: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The size, per direction, that best divides those who step from those who stand: there postures decide."""
    equal = impulse.copy()
    for sign in DIRECTIONS.values():
        mine = np.sign(impulse) == sign
        size = best_threshold(np.abs(impulse[mine]), steps[mine])
        equal[mine] = sign * (size if np.isfinite(size) else np.median(np.abs(impulse[mine])))
    return equal


def _frame(motions, levels, scene, pushes, ends, equal, equal_steps) -> pd.DataFrame:
    import pandas as pd

    since = (pushes.instant - scene.references.first[pushes.lift]) * scene.references.step
    time = np.array([motions[index].time[0] for index in pushes.lift]) + since
    forward = pushes.impulse > 0

    def at_push(values_of) -> np.ndarray:
        found = np.empty(len(time))
        for index, level in enumerate(levels):
            mine = pushes.lift == index
            found[mine] = np.interp(time[mine], level.time, values_of(level))
        return found

    columns = {
        "subject": [motions[index].subject for index in pushes.lift],
        "lift": [motions[index].lift for index in pushes.lift],
        "time_s": time,
        "direction": np.where(forward, FORWARD, BACKWARD),
        "impulse_N_s": np.abs(pushes.impulse),
        "outcome": ends.outcome,
        "steps": ends.steps,
        "equal_impulse_N_s": np.abs(equal),
        "equal_steps": equal_steps,
        "shift_m_per_N_s": at_push(lambda level: level.shift),
    }
    for name in PREDICTORS:
        sides = [at_push(lambda level, key=(name, side): level.values[key]) for side in (FORWARD, BACKWARD)]
        columns[f"level_{name}"] = np.where(forward, *sides)
    return pd.DataFrame(columns, columns=list(COLUMNS))
