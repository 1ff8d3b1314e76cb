"""``lumbar.push_prediction``: which measure, computed before a push, tells who must step."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.base.files import read_json
from lumbar.interface.lift import Lift
from lumbar.interface.verb import Result, data_label, read_table
from lumbar.lifting.measures.course import Lifter
from lumbar.lifting.pushes.contest import COLUMNS, Contest, contest_of, push_bodies
from lumbar.lifting.pushes.levels import from_states, levels_of, states_frame
from lumbar.lifting.pushes.motion import deposit_motion
from lumbar.lifting.pushes.prediction import (
    Followed,
    Verdict,
    chances,
    follow,
    prediction_frame,
    prediction_table,
    sensitivity_frame,
    sensitivity_table,
    verdict_json,
    verdict_of,
)
from lumbar.lifting.stability.model.trajectories import trajectories_of_lift
from lumbar.settings.key import SEED
from lumbar.settings.pushes import PushesSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.table import Table


@dataclass(frozen=True)
class SavedLift:
    """What `Lift.save` wrote of a lift: ``body.csv``, ``pendulum.csv`` and ``pendulum.json``."""

    body: pd.DataFrame
    states: pd.DataFrame
    facts: dict


def saved_lift(folder: str | os.PathLike) -> SavedLift:
    """Read a lift's folder."""
    folder = Path(folder)
    body, states = (read_table(folder / f"{name}.csv", "a lift") for name in ("body", "pendulum"))
    return SavedLift(body, states, read_json(folder / "pendulum.json"))


def push_states(
    lifts: Iterable[Lift | SavedLift], stability: StabilitySettings, push_share: float
) -> pd.DataFrame:
    """Return what the pushes need of some lifts: motion and levels of the measures, one row per instant of a deposit.

    A lift from which no body can be made (no deposit, no feet, no shoulders) is left out.

    `push_share` says where the trunk is pushed, between hips and shoulders (``pushes.push.height_share``).
    """
    lifters, motions, trajectories = [], [], []
    for item in lifts:
        lifter = Lifter(item.body, item.facts, stability.measures, stability.pendulum.gravity_m_s2)
        try:
            motions.append(deposit_motion(lifter))
        except InputError:
            continue
        lifters.append(lifter)
        sound, _ = trajectories_of_lift(item.states, item.facts, stability.pendulum.mass)
        chosen = [one for one in sound if (one.com, one.plane) == ("abdomen", "flexion_extension")]
        trajectories.append(next(iter(chosen), None))
    levels = levels_of(lifters, motions, trajectories, stability, push_share)
    return states_frame(motions, levels)


def push_prediction(
    lifts: Iterable[Lift] | pd.DataFrame,
    *,
    settings: PushesSettings | None = None,
    stability: StabilitySettings | None = None,
    seed: int = SEED,
    data: str = "",
) -> "PushPrediction":
    """Push simulated bodies of three links during the deposits of some lifts, and see which measure told who must step.

    Parameters
    ----------
    lifts : list of Lift, or pandas.DataFrame
        Of `lift`, of several persons; or a table of `lumbar.interface.pushing.push_states`.
    stability : StabilitySettings, optional
        Measures and basins.
    seed : int
        Of pushes, traits of the bodies and bootstrap.
    data : str
        Words for the source of the data.

    Raises
    ------
    InputError
        If no lift gives a body, the lifts are all one person's, or all pushes end alike.

    Examples
    --------
    Two persons who move alike, pushed a few times: no interval below 8 persons, and which measure leads is chance.

    >>> from dataclasses import replace
    >>> import lumbar
    >>> from lumbar.settings.pushes import PushesSettings, PushSettings
    >>> from lumbar.twin.examples import example_lift
    >>> ann = example_lift("lift.c3d")
    >>> people = [ann, replace(ann, name="bob")]
    >>> lifts = [lumbar.lift("lift.c3d", person, box_mass_kg=15) for person in people]
    >>> settings = PushesSettings(push=PushSettings(per_lift=24))
    >>> found = lumbar.push_prediction(lifts, settings=settings)
    >>> len(found.pushes)
    48
    >>> print(found.winner.low)
    None
    """
    settings, stability = settings or PushesSettings(), stability or StabilitySettings()
    states: pd.DataFrame = lifts
    sources: dict[str, None] = {}
    if not hasattr(lifts, "columns"):
        lifts = list(lifts)
        states = push_states(lifts, stability, settings.push.height_share)
        sources = dict.fromkeys(item.data for item in lifts)
    drawn = push_outcomes(states, settings, seed)
    label = data_label(data, sources)
    return _scored(drawn, lambda names: states[states["lift"].isin(names)], settings, seed, label)


def push_outcomes(states: pd.DataFrame, settings: PushesSettings, seed: int) -> pd.DataFrame:
    """Push the bodies of some lifts, person after person: what a person's pushes end in hangs on nobody else.

    From `push_states` to one row per push, columns `lumbar.lifting.pushes.contest.COLUMNS`.
    """
    people = [part for _, part in states.groupby("subject", sort=False)] if len(states) else []
    frames = [push_bodies(*from_states(part), settings, seed) for part in people]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=list(COLUMNS))


def pooled_prediction(
    outcomes: Sequence[str | os.PathLike],
    states: Sequence[str | os.PathLike],
    settings: PushesSettings,
    seed: int,
    data: str,
) -> "PushPrediction":
    """Score the pushes of many persons or lifts, of which files were written.

    Of the states only those of the few lifts are read whose pushes are followed with other bodies.

    `outcomes` and `states` are CSV files of `push_outcomes` and of `push_states`, in the same order.
    """
    file_of: dict[str, str | os.PathLike] = {}
    frames = []
    for path, source in zip(outcomes, states, strict=True):
        frame = read_table(path, "pushes")
        file_of |= dict.fromkeys(frame["lift"].unique(), source)
        frames.append(frame)
    drawn = pd.concat([frame for frame in frames if len(frame)] or frames, ignore_index=True)
    del frames

    def states_of(names: Sequence[str]) -> pd.DataFrame:
        read = (
            read_table(path, "states of pushes") for path in dict.fromkeys(file_of[name] for name in names)
        )
        return pd.concat([frame[frame["lift"].isin(names)] for frame in read], ignore_index=True)

    return _scored(drawn, states_of, settings, seed, data)


def _scored(
    drawn: pd.DataFrame,
    states_of: Callable[[Sequence[str]], pd.DataFrame],
    settings: PushesSettings,
    seed: int,
    data: str,
) -> "PushPrediction":
    """Score all pushes drawn; `states_of` gives the states of some lifts."""
    if drawn.empty:
        raise InputError(
            "pushes: of no lift a body of three links can be made: each needs a deposit, both ankles, heels, toes and shoulders, "
            "the hips, and the box or the wrists"
        )
    people = drawn["subject"].unique()
    if len(people) < 2:
        raise InputError(
            f"pushes: all lifts are those of {', '.join(people)}; who must step is told by a threshold of other persons: give "
            "lifts of two persons at least"
        )
    contest = contest_of(drawn)
    followed = follow(
        drawn["lift"].unique(), settings.push.per_lift, lambda names: from_states(states_of(names))
    )
    return PushPrediction(contest, followed, settings, seed, data)


@dataclass(frozen=True, eq=False, repr=False)
class PushPrediction(Result):
    """The contest of the measures."""

    shown = "frame"
    contest: Contest
    """Pushes, their outcomes, and what the measures said before."""
    followed: Followed
    """Those that are followed with other bodies too."""
    settings: PushesSettings
    seed: int
    data: str

    @property
    def pushes(self) -> pd.DataFrame:
        """One row per push: size, outcome, and the level of every measure."""
        return self.contest.frame

    @cached_property
    def chances(self) -> dict[tuple[str, str], np.ndarray]:
        """Log odds of a step of every push, shape (pushes,), by measure, alone or added to push, mass and direction."""
        return chances(self.contest, self.settings.scoring, self.seed)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """One row per contest, direction and measure, the best first."""
        return prediction_frame(self.contest, self.chances, self.settings.scoring, self.seed)

    @cached_property
    def winner(self) -> Verdict:
        """The measure that adds most, with its interval and what it rests on."""
        return verdict_of(self.contest, self.frame, self.chances, self.settings.scoring)

    @property
    def table(self) -> Table:
        """The contests as a published table."""
        return prediction_table(self.contest, self.frame, self.winner, self.data)

    @cached_property
    def sensitivity(self) -> Table:
        """The contest with other bodies and controllers."""
        frame = sensitivity_frame(self.followed, self.settings, self.winner, self.seed)
        return sensitivity_table(frame, self.winner, self.data)

    def figure(self):
        """Draw the ROC curves."""
        from lumbar.publishing.figures.push_figures import push_figure

        return push_figure(self.contest.frame, self.frame, self.chances)

    def files(self) -> Iterator[tuple[str, Any]]:
        """``pushes.csv``, ``winner.json`` and the tables ``push_prediction`` and ``push_sensitivity``."""
        yield "pushes.csv", self.pushes.assign(data=self.data)
        yield "winner.json", verdict_json(self.winner, self.data)
        yield "push_prediction", self.table
        yield "push_sensitivity", self.sensitivity

    def __str__(self) -> str:
        return self.winner.sentence

    def __repr__(self) -> str:
        return f"<PushPrediction: {len(self.pushes)} pushes, {self.winner.measure}>"
