"""Which measure tells who must step, and what it adds to what anybody knows: the push, its direction and the mass.

Every measure is told the same and takes part under the same rule (`chances`), baselines and ablations too. They are ranked by the
increment: how much larger the area under the ROC becomes where a measure joins the push's size and direction and the mass.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from lumbar.base.errors import InputError
from lumbar.base.yaml_file import shipped_yaml
from lumbar.lifting.population.contrast import jackknife_interval
from lumbar.lifting.pushes.chances import ADDED, ALONE, KNOWN, KNOWN_WORDS, chances_of
from lumbar.lifting.pushes.contest import Contest, contest_of, push_bodies
from lumbar.lifting.pushes.levels import BASELINES, DIRECTIONS, PREDICTORS, Levels
from lumbar.lifting.pushes.motion import DepositMotion
from lumbar.lifting.pushes.roc import (
    SPECIFICITY,
    area,
    area_interval,
    areas,
    cross_validated_rates,
    left_out,
    sensitivity_at,
    sort_scores,
)
from lumbar.settings.pushes import PushesSettings, ScoringSettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

ALL_SIZES, EQUAL = "all sizes", "equal pushes"
BOTH = "both"
VARIED = {
    "delay": ("delay", (0.7, 1.4)),
    "cost of torque": ("effort", (0.1, 10.0)),
    "strength": ("strength", (0.7, 1.4)),
    "foot length": ("foot", (0.85, 1.15)),
}
"""Traits of all persons that the table of sensitivities changes, and by which factors. A costly torque makes low gains."""
FOLLOWED = 360
"""Pushes that are followed for each row of it, about: every so many of the contest's."""
_SAID: dict[str, str] = shipped_yaml(Path(__file__).with_suffix(".yaml"))
NEGLIGIBLE = 0.01
"""Difference of two areas below which one measure is as good as the other."""
BASIS = "simulated bodies under an assumed controller, not people"


@dataclass(frozen=True)
class Verdict:
    """The measure that adds most, and what that rests on."""

    measure: str
    increment: float
    low: float | None
    high: float | None
    """`low`, `high`: 95 % interval over persons of the increment; None with too few of them."""
    known_auc: float
    """Area of the push's size, the mass and the direction without any measure."""
    auc: float
    """Area of the measure alone."""
    best_alone: str
    """What has the largest area alone; a baseline can be it."""
    tied: tuple[str, ...]
    """Measures than which it is not shown to add more."""
    equal: dict[str, str]
    """Best by direction under equal pushes."""
    sentence: str


def scores_of(
    frame: pd.DataFrame, name: str, contest: str, chances: Mapping[tuple[str, str], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Scores of one measure alone, higher meaning a step, and who stepped, shape (pushes,) each."""
    if contest == EQUAL:
        return -frame[f"level_{name}"].to_numpy(float), frame["equal_steps"].to_numpy(bool)
    return chances[name, ALONE], frame["steps"].to_numpy(bool)


def pushes_of(frame: pd.DataFrame, direction: str) -> np.ndarray:
    """Which pushes are those of one direction, or of both; shape (pushes,)."""
    return np.full(len(frame), True) if direction == BOTH else (frame["direction"] == direction).to_numpy()


def chances(contest: Contest, scoring: ScoringSettings, seed: int) -> dict[tuple[str, str], np.ndarray]:
    """Log odds of a step of every push by every measure, alone and added (`chances_of`)."""
    return chances_of(contest.frame, list(PREDICTORS), scoring.folds, [seed, 4])


def prediction_frame(contest: Contest, told: Mapping, scoring: ScoringSettings, seed: int) -> pd.DataFrame:
    """Score all measures; one row per contest, direction and measure, the columns of ``push_prediction.csv``, the best first.

    A measure without a level at every push (no basin) is left out. `told` is of `chances`.
    """
    frame, rows = contest.frame, []
    person = np.unique(frame["subject"].to_numpy(str), return_inverse=True)[1]
    for kind, direction in ((ALL_SIZES, BOTH), *((k, d) for k in (ALL_SIZES, EQUAL) for d in DIRECTIONS)):
        here = pushes_of(frame, direction)
        for name in (KNOWN, *PREDICTORS):
            if (name, ALONE) not in told or (kind == EQUAL and name in (KNOWN, "push_alone")):
                continue
            values, steps = (item[here] for item in scores_of(frame, name, kind, told))
            if not steps.any() or steps.all():
                continue
            row = {"contest": kind, "direction": direction, "measure": name}
            row |= _alone(values, steps, person[here], scoring, seed)
            if kind == ALL_SIZES and name not in (KNOWN, *BASELINES):
                row |= increment_of(
                    told[name, ADDED][here], told[KNOWN, ALONE][here], steps, person[here], scoring
                )
            rows.append(row)
    table = pd.DataFrame(rows, columns=columns_of(__file__, "push_prediction"))
    by = ["contest", "direction", "increment", "auc"]
    order = table[by].assign(contest=[kind == EQUAL for kind in table["contest"]])
    order["direction"] = [[BOTH, *DIRECTIONS].index(item) for item in table["direction"]]
    return table.loc[order.sort_values(by, ascending=[True, True, False, False]).index].reset_index(drop=True)


def _alone(values, steps, person, scoring: ScoringSettings, seed: int) -> dict:
    whole = area(values, steps)
    low, high = _interval(whole, sort_scores(values, steps, person), None, person, scoring)
    failures, successes = cross_validated_rates(values, steps, person, scoring.folds, [seed, 4])
    return {
        "auc": whole,
        "auc_low": low,
        "auc_high": high,
        "sensitivity_95": sensitivity_at(values, steps, SPECIFICITY),
        "failures_right": failures,
        "successes_right": successes,
        "pushes": len(steps),
        "steps": int(steps.sum()),
        "persons": len(np.unique(person)),
    }


def increment_of(added, known, steps, person, scoring: ScoringSettings) -> dict:
    """How much larger the area is with a measure than without, and its interval over persons; arrays of shape (pushes,)."""
    whole = area(added, steps) - area(known, steps)
    low, high = _interval(
        whole, sort_scores(added, steps, person), sort_scores(known, steps, person), person, scoring
    )
    return {"increment": whole, "increment_low": low, "increment_high": high}


def _interval(whole, scores, less, person, scoring: ScoringSettings) -> tuple[float | None, float | None]:
    """Interval over persons of an area, or of its difference from that of other scores; None twice where there is none."""
    persons = np.unique(person)
    if len(persons) < scoring.fewest_persons:
        return None, None
    weights = left_out(int(person.max()) + 1)[persons]
    parts = areas(scores, weights)
    if less is None:
        return area_interval(whole, parts) or (None, None)
    low, high = jackknife_interval(whole, parts - areas(less, weights))
    return float(low), float(high)


def verdict_of(contest: Contest, table: pd.DataFrame, told: Mapping, scoring: ScoringSettings) -> Verdict:
    """Name the measure with the largest increment, pushes of all sizes, both directions."""
    main = table[(table["contest"] == ALL_SIZES) & (table["direction"] == BOTH)].set_index("measure")
    best = main.iloc[0]
    name = str(best.name)
    tied = _tied(
        contest.frame, name, [item for item in main.index if main["increment"].notna()[item]], told, scoring
    )
    ranked = table[table["contest"] == EQUAL].drop_duplicates("direction").set_index("direction")
    low, high = (
        None if best[end] is None or np.isnan(best[end]) else float(best[end])
        for end in ("increment_low", "increment_high")
    )
    found = Verdict(
        name,
        float(best["increment"]),
        low,
        high,
        float(main.loc[KNOWN, "auc"]),
        float(best["auc"]),
        str(main["auc"].idxmax()),
        tied,
        dict(ranked["measure"]),
        "",
    )
    return replace(found, sentence=_sentence(found, main, ranked, scoring))


def _sentence(found: Verdict, main: pd.DataFrame, ranked: pd.DataFrame, scoring: ScoringSettings) -> str:
    best, persons, points = main.loc[found.measure], int(main["persons"].max()), 100 * found.increment
    span = _SAID["few"].format(persons=persons, fewest=scoring.fewest_persons)
    if found.low is not None:
        span = _SAID["interval"].format(low=100 * found.low, high=100 * found.high, persons=persons)
    adds = _SAID["adds"].format(found=found, points=points, span=span)
    if found.low is not None and found.low <= 0:
        adds = _SAID["none_adds"].format(adds=adds)
    parts = [_SAID["pairs"].format(known=KNOWN_WORDS, auc=100 * found.known_auc, adds=adds)]
    if found.tied:
        parts.append(_SAID["tied"].format(negligible=100 * NEGLIGIBLE, tied=", ".join(found.tied)))
    aucs = "; ".join(f"{name} {100 * main.loc[name, 'auc']:.1f} %" for name in (found.measure, *BASELINES))
    right = {name: 100 * best[f"{name}_right"] for name in ("failures", "successes")}
    parts.append(_SAID["alone"].format(found=found, aucs=aucs, **right))
    for direction, row in (
        ranked.iterrows() if found.low is not None else ()
    ):  # of a few persons the order is chance
        parts.append(_SAID["equal"].format(direction=direction, measure=row["measure"], auc=row["auc"]))
    return " ".join([*parts, _SAID["basis"].format(basis=BASIS)])


def _tied(
    frame: pd.DataFrame, best: str, names: list[str], told: Mapping, scoring: ScoringSettings
) -> tuple[str, ...]:
    """Measures than which the best one is not shown to add `NEGLIGIBLE` more, by an interval over persons."""
    steps = frame["steps"].to_numpy(bool)
    person = np.unique(frame["subject"].to_numpy(str), return_inverse=True)[1]
    tied = []
    for name in names:
        low = increment_of(told[best, ADDED], told[name, ADDED], steps, person, scoring)["increment_low"]
        if name != best and low is not None and low < NEGLIGIBLE:
            tied.append(name)
    return tuple(tied)


def prediction_table(contest: Contest, table: pd.DataFrame, verdict: Verdict, data: str) -> Table:
    """Return the two contests as a published table."""
    words = {
        "verdict": verdict.sentence,
        "drawn": contest.drawn,
        "unsteady": contest.unsteady,
        "name": KNOWN,
        "known": KNOWN_WORDS,
    }
    notes = [
        f"{name}: {item.meaning}" for name, item in PREDICTORS.items() if (table["measure"] == name).any()
    ]
    return described(__file__, "push_prediction", table, data, words, notes=notes)


@dataclass(frozen=True)
class Followed:
    """Some of a contest's pushes, for the contests with other bodies."""

    motions: list[DepositMotion]
    levels: list[Levels]
    """Of the lifts that they belong to."""
    chosen: np.ndarray
    """Which of the pushes of these lifts, counted lift after lift."""


def follow(
    lifts: Sequence[str],
    per_lift: int,
    bodies_of: Callable[[Sequence[str]], tuple[list[DepositMotion], list[Levels]]],
) -> Followed:
    """Choose about `FOLLOWED` of all pushes, evenly taken, and get the bodies that they need.

    There are `per_lift` pushes in each of the lifts; `bodies_of` gives motions and levels of some of them.
    """
    # Directions take turns: an even stride would follow those of one alone.
    taken = np.arange(0, len(lifts) * per_lift, (len(lifts) * per_lift // FOLLOWED) | 1)
    numbers: dict[str, list[int]] = {}
    for push in taken:
        numbers.setdefault(lifts[push // per_lift], []).append(push % per_lift)
    motions, levels = bodies_of(list(numbers))
    chosen = [index * per_lift + np.array(numbers[item.lift]) for index, item in enumerate(motions)]
    return Followed(motions, levels, np.concatenate(chosen))


def sensitivity_frame(
    followed: Followed, settings: PushesSettings, verdict: Verdict, seed: int
) -> pd.DataFrame:
    """Hold the contest with other bodies and controllers."""
    rows = []
    varied = [
        (what, factor, {field: factor}) for what, (field, factors) in VARIED.items() for factor in factors
    ]
    for what, factor, changed in [("nothing", 1.0, {}), *varied]:
        try:
            drawn = push_bodies(
                followed.motions, followed.levels, settings, seed, changed, followed.chosen, equal=False
            )
            frame = contest_of(drawn).frame
        except InputError:
            # Nobody steps any more, or everybody: there is nothing to tell.
            rows.append({"changed": what, "factor": factor, "pushes": 0})
            continue
        told = chances_of(frame, list(PREDICTORS), settings.scoring.folds, [seed, 4])
        steps = frame["steps"].to_numpy(bool)
        known = area(told[KNOWN, ALONE], steps)
        found = {name: area(told[name, ADDED], steps) - known for name, kind in told if kind == ADDED}
        ranking = sorted(found.keys() - BASELINES, key=lambda name: -found[name])
        rows.append(
            {
                "changed": what,
                "factor": factor,
                "pushes": len(frame),
                "steps": float(frame["steps"].mean()),
                "known_auc": known,
                "winner": ranking[0],
                "winner_increment": found[ranking[0]],
                "headline_increment": found.get(verdict.measure),
                "headline_rank": ranking.index(verdict.measure) + 1 if verdict.measure in found else None,
            }
        )
    return pd.DataFrame(rows, columns=columns_of(__file__, "push_sensitivity")).astype(
        {"headline_rank": "Int64"}
    )


def sensitivity_table(frame: pd.DataFrame, verdict: Verdict, data: str) -> Table:
    """Return the contests with other bodies and controllers as a published table."""
    words = {
        "verdict": verdict,
        "same": int((frame["winner"] == verdict.measure).sum()),
        "all": len(frame),
        "followed": FOLLOWED,
        "known": KNOWN_WORDS,
    }
    return described(__file__, "push_sensitivity", frame, data, words)


def verdict_json(verdict: Verdict, data: str) -> dict:
    """Return the measure that adds most as other pages read it: ``pushes/winner.json``."""
    return {
        "schema": "lumbar.push_prediction/2",
        "measure": verdict.measure,
        "adds": verdict.low is not None and verdict.low > 0,
        "increment": verdict.increment,
        "increment_low": verdict.low,
        "increment_high": verdict.high,
        "known": KNOWN_WORDS,
        "known_auc": verdict.known_auc,
        "auc": verdict.auc,
        "best_alone": verdict.best_alone,
        "not_shown_better_than": list(verdict.tied),
        "equal_pushes": verdict.equal,
        "sentence": verdict.sentence,
        "rests_on": BASIS,
        "data": data,
    }
