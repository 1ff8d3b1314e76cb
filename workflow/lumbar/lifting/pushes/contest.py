"""The contest: random pushes against the simulated bodies of lifts, and what every measure said before.

Two contests: pushes of all sizes, in which a measure may use the size; and pushes of one size per direction, which ask whether a
measure ranks people and postures. An instant at which the body would step without any push is no test of a push and is left
out; how many were is counted. Pushes and traits hang on the seed and the names of lift and person alone, so that whoever is
added to a study changes nobody else's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.lifting.pushes.levels import BACKWARD, FORWARD, PREDICTORS, Levels
from lumbar.lifting.pushes.motion import DepositMotion, bodies_of, references_of
from lumbar.lifting.pushes.simulation import (
    Pushes,
    Scene,
    Traits,
    draw_traits,
    generator,
    persons_of,
    simulate,
)
from lumbar.settings.pushes import PushesSettings

STANDS, FALLS, UNSTEADY = "stands", "falls", "unsteady"
"""Outcomes of a push; the last at an instant at which the body would fall without it."""
COLUMNS = (
    *("subject", "lift", "time_s", "direction", "impulse_N_s", "outcome", "steps"),
    *("equal_impulse_N_s", "equal_steps", "shift_m_per_N_s", *(f"level_{name}" for name in PREDICTORS)),
)
"""Columns of ``pushes.csv``, all that the ROC is made of: of those called equal, the push at the same instant in the contest of
equal pushes; the shift is 1/(m·ω0), how far a push moves the extrapolated centre of mass."""


@dataclass(frozen=True)
class Contest:
    """Pushes with their outcomes and levels."""

    frame: pd.DataFrame
    """One row per push; columns `COLUMNS`."""
    drawn: int
    """Pushes drawn."""
    unsteady: int
    """Those left out because the body would step without a push."""


def draw_pushes(motions: list[DepositMotion], scene: Scene, settings: PushesSettings, seed: int) -> Pushes:
    """Draw instants evenly likely within every deposit, directions in turn, and sizes evenly likely."""
    push, references = settings.push, scene.references
    streams = [generator(seed, "pushes", f"{item.subject}, {item.lift}") for item in motions]
    shares = np.hstack([stream.random((2, push.per_lift)) for stream in streams])
    lift = np.repeat(np.arange(len(motions)), push.per_lift)
    first, last = references.first[lift], references.last[lift]
    instant = first + (shares[0] * (last - first)).astype(int)
    sign = np.where(np.tile(np.arange(push.per_lift), len(motions)) % 2 == 0, 1.0, -1.0)
    low, high = (np.where(sign > 0, push.forward_N_s[k], push.backward_N_s[k]) for k in range(2))
    return Pushes(lift, instant, sign * (low + shares[1] * (high - low)))


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


def push_bodies(
    motions: list[DepositMotion],
    levels: list[Levels],
    settings: PushesSettings,
    seed: int,
    changed: Mapping[str, float] | None = None,
    chosen: np.ndarray | None = None,
    equal: bool = True,
) -> pd.DataFrame:
    """Push the bodies of some lifts and put beside each push what the measures said before it; columns `COLUMNS`.

    Where the body would step without a push, the outcome is `UNSTEADY`.

    Parameters
    ----------
    changed : mapping of str to float, optional
        Factors on everybody's traits, by the attributes of `Traits`: what no measure is told.
    chosen : numpy.ndarray of int, optional
        Which of the pushes are followed, counted lift after lift; all.
    equal : bool
        Whether equal pushes are simulated too; without them their columns repeat the others.
    """
    traits = draw_traits([item.subject for item in motions], settings.controller, settings.spread, seed)
    traits = replace(
        traits, **{name: factor * getattr(traits, name) for name, factor in (changed or {}).items()}
    )
    scene = scene_of(motions, settings, traits)
    drawn = draw_pushes(motions, scene, settings, seed)
    if chosen is not None:
        drawn = Pushes(drawn.lift[chosen], drawn.instant[chosen], drawn.impulse[chosen])
    sizes = [0 * drawn.impulse, drawn.impulse]
    if equal:
        forward, backward = settings.push.equal_forward_N_s, settings.push.equal_backward_N_s
        sizes.append(np.where(drawn.impulse > 0, forward, -backward))
    # All at once: a step of the integration costs little more for three times as many pushes.
    count = len(sizes)
    ends = simulate(
        scene, Pushes(np.tile(drawn.lift, count), np.tile(drawn.instant, count), np.concatenate(sizes))
    )
    steps = np.split(ends.falls, count)
    outcome = np.where(steps[0], UNSTEADY, np.where(steps[1], FALLS, STANDS))
    return _frame(motions, levels, scene, drawn, outcome, steps[1], sizes[-1], steps[-1])


def contest_of(drawn: pd.DataFrame) -> Contest:
    """Return the contest of all pushes that were drawn (`push_bodies`), those at unsteady instants left out.

    Raises
    ------
    InputError
        All pushes end alike, or none is a test.
    """
    steady = (drawn["outcome"] != UNSTEADY).to_numpy()
    frame = drawn[steady].reset_index(drop=True)
    unsteady = int((~steady).sum())
    if frame["steps"].all() or not frame["steps"].any():
        raise InputError(
            f"pushes: {frame['steps'].sum()} of {len(frame)} pushes make the bodies step, and {unsteady} would step "
            "without one; both outcomes are needed: change pushes.push.forward_N_s or backward_N_s"
        )
    return Contest(frame, len(drawn), unsteady)


def _frame(motions, levels, scene, pushes, outcome, steps, equal, equal_steps) -> pd.DataFrame:
    since = (pushes.instant - scene.references.first[pushes.lift]) * scene.references.step
    time = np.array([motions[index].time[0] for index in pushes.lift]) + since
    forward = pushes.impulse > 0

    def at_push(course_of) -> np.ndarray:
        found = np.empty(len(time))
        for index, level in enumerate(levels):
            mine = pushes.lift == index
            found[mine] = np.interp(time[mine], level.time, course_of(level))
        return found

    columns = {
        "subject": [motions[index].subject for index in pushes.lift],
        "lift": [motions[index].lift for index in pushes.lift],
        "time_s": time,
        "direction": np.where(forward, FORWARD, BACKWARD),
        "impulse_N_s": np.abs(pushes.impulse),
        "outcome": outcome,
        "steps": steps,
        "equal_impulse_N_s": np.abs(equal),
        "equal_steps": equal_steps,
        "shift_m_per_N_s": at_push(lambda level: level.shift),
    }
    for name in PREDICTORS:
        sides = [at_push(lambda level, key=(name, side): level.values[key]) for side in (FORWARD, BACKWARD)]
        columns[f"level_{name}"] = np.where(forward, *sides)
    return pd.DataFrame(columns, columns=list(COLUMNS))
