"""Which measure told best who would step: areas under the ROC, thresholds of other persons, the winner and what it rests on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import InputError
from lumbar.lifting.pushes.contest import Contest, contest_of, push_bodies
from lumbar.lifting.pushes.levels import BASELINES, DIRECTIONS, NOTHING, PREDICTORS, Levels, score
from lumbar.lifting.pushes.motion import DepositMotion
from lumbar.lifting.pushes.roc import (
    SPECIFICITY,
    area,
    areas,
    cross_validated_rates,
    interval,
    person_weights,
    sensitivity_at,
    sort_scores,
)
from lumbar.tables.table import Table

if TYPE_CHECKING:
    import pandas as pd

    from lumbar.settings.pushes import PushesSettings, ScoringSettings

ALL_SIZES, EQUAL = "all sizes", "equal pushes"
BOTH = "both"
COLUMNS = {
    "contest": "all sizes: random pushes, the measure may use the size; equal pushes: one size per direction, the measure ranks "
    "persons and postures",
    "direction": "of the pushes",
    "measure": "its name; the note says what each is",
    "auc": "area under the ROC: share of pairs, one who steps and one who stands, that the measure orders rightly; below 0.5 it "
    "tells the wrong way round",
    "auc_low": "lower end of its 95 % interval over persons (cluster bootstrap)",
    "auc_high": "upper end",
    "sensitivity_95": "share of those who step that it tells while it is right about 95 % of those who stand",
    "failures_right": "share of those who step told right by the best threshold of other persons (cross-validated)",
    "successes_right": "share of those who stand told right by it",
    "pushes": "pushes in this row",
    "steps": "pushes of them after which the simulated person must step",
    "persons": "simulated persons",
}
"""Columns of ``push_prediction.csv``."""
VARIED = {
    "delay": ("delay", (0.7, 1.4)),
    "cost of torque": ("effort", (0.1, 10.0)),
    "strength": ("strength", (0.7, 1.4)),
    "foot length": ("foot", (0.85, 1.15)),
}
"""Traits of all persons that the table of sensitivities changes, and by which factors. A costly torque makes low gains."""
FOLLOWED = 360
"""Pushes that are followed for each row of it, about: every so many of the contest's."""
SENSITIVITY_COLUMNS = {
    "changed": "what no measure is told and was changed for everybody",
    "factor": "by this factor",
    "pushes": "pushes that were a test",
    "steps": "share of them after which the simulated person must step",
    "winner": "measure with the largest area under the ROC, all sizes, both directions",
    "winner_auc": "its area",
    "headline_auc": "area of the measure that wins without the change",
    "headline_rank": "its rank",
}
HOLMES = (
    "Holmes et al. (2019), backward reachable sets of 11 recorded people standing up: more than 90 % of the failures and more "
    "than 95 % of the successes"
)
NEGLIGIBLE = 0.01
"""Difference of two areas below which one measure is as good as the other."""
BASIS = "simulated bodies under an assumed controller, not people"


@dataclass(frozen=True)
class Verdict:
    """The winner and what it rests on."""

    measure: str
    auc: float
    low: float | None
    high: float | None
    """`low`, `high`: 95 % interval over persons; None with too few of them."""
    tied: tuple[str, ...]
    """Measures than which it is not shown to be better by `NEGLIGIBLE`."""
    equal: dict[str, str]
    """Winner by direction under equal pushes."""
    sentence: str


def scores_of(frame: pd.DataFrame, name: str, contest: str) -> tuple[np.ndarray, np.ndarray]:
    """Scores of one measure, higher meaning a step, and who stepped, shape (pushes,) each."""
    level = frame[f"level_{name}"].to_numpy(float)
    if contest == EQUAL:
        return -level, frame["equal_steps"].to_numpy(bool)
    size, shift = frame["impulse_N_s"].to_numpy(float), frame["shift_m_per_N_s"].to_numpy(float)
    return score(name, level, size, shift), frame["steps"].to_numpy(bool)


def contestants(contest: str) -> list[str]:
    """Measures that can take part: pushes of all sizes need one that a push can enter."""
    if contest == EQUAL:
        return [name for name in PREDICTORS if name != "push_alone"]
    return [name for name, item in PREDICTORS.items() if item.push != NOTHING]


def rows_of(frame: pd.DataFrame, direction: str) -> pd.DataFrame:
    """Pushes of one direction, or of both."""
    return frame if direction == BOTH else frame[frame["direction"] == direction]


def prediction_frame(contest: Contest, scoring: ScoringSettings, seed: int) -> pd.DataFrame:
    """Score all measures; one row per contest, direction and measure, columns `COLUMNS`, the best first.

    A measure without a level at every push (no basin) is left out.
    """
    import pandas as pd

    frame, rows = contest.frame, []
    names = sorted(frame["subject"].unique())
    weights = person_weights(len(names), scoring.resamples, [seed, 3])
    for kind, direction in ((ALL_SIZES, BOTH), *((k, d) for k in (ALL_SIZES, EQUAL) for d in DIRECTIONS)):
        part = rows_of(frame, direction)
        person = np.searchsorted(names, part["subject"].to_numpy(str))
        found = []
        for name in contestants(kind):
            values, steps = scores_of(part, name, kind)
            if np.isfinite(values).all() and steps.any() and not steps.all():
                found.append(_row(kind, direction, name, values, steps, person, weights, scoring, seed))
        rows += sorted(found, key=lambda row: -row["auc"])
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _row(kind, direction, name, values, steps, person, weights, scoring, seed) -> dict:
    low = high = None
    if weights.shape[1] >= scoring.fewest_persons:
        low, high = interval(areas(sort_scores(values, steps, person), weights))
    failures, successes = cross_validated_rates(values, steps, person, scoring.folds, [seed, 4])
    return {
        "contest": kind,
        "direction": direction,
        "measure": name,
        "auc": area(values, steps),
        "auc_low": low,
        "auc_high": high,
        "sensitivity_95": sensitivity_at(values, steps, SPECIFICITY),
        "failures_right": failures,
        "successes_right": successes,
        "pushes": len(steps),
        "steps": int(steps.sum()),
        "persons": len(np.unique(person)),
    }


def verdict_of(contest: Contest, table: pd.DataFrame, scoring: ScoringSettings, seed: int) -> Verdict:
    """Name the winner: largest area with pushes of all sizes, both directions; baselines cannot win."""
    main = table[(table["contest"] == ALL_SIZES) & (table["direction"] == BOTH)]
    best = main[~main["measure"].isin(BASELINES)].iloc[0]
    enough = bool(best["persons"] >= scoring.fewest_persons)
    tied = _tied(contest.frame, best["measure"], list(main["measure"]), scoring, seed) if enough else ()
    ranked = table[table["contest"] == EQUAL].drop_duplicates("direction").set_index("direction")
    low, high = (float(best[name]) if enough else None for name in ("auc_low", "auc_high"))
    found = Verdict(best["measure"], float(best["auc"]), low, high, tied, dict(ranked["measure"]), "")
    return replace(found, sentence=_sentence(found, best, main, ranked, scoring))


def _sentence(
    found: Verdict, best, main: pd.DataFrame, ranked: pd.DataFrame, scoring: ScoringSettings
) -> str:
    alone = main[main["measure"] == "push_alone"].iloc[0]["auc"]
    span = (
        f"{found.low:.3f} to {found.high:.3f} over {best['persons']} simulated persons"
        if found.low is not None
        else f"no interval: {best['persons']} persons, at least {scoring.fewest_persons} are needed"
    )
    parts = [
        f"{found.measure} told best who would step: of all pairs, one who steps and one who stands, it ordered "
        f"{100 * found.auc:.1f} % rightly (area under the ROC {found.auc:.3f}, {span}; the push alone {alone:.3f}), and by a "
        f"threshold of other persons it was right about {100 * best['failures_right']:.0f} % of those who had to step and "
        f"{100 * best['successes_right']:.0f} % of those who stood ({HOLMES})."
    ]
    if found.tied:
        parts.append(f"It is not shown to be better by {NEGLIGIBLE:g} or more than {', '.join(found.tied)}.")
    enough = ranked.iterrows() if found.low is not None else ()  # of a few persons the order is chance
    for direction, row in enough:
        parts.append(f"Under equal pushes {direction} {row['measure']} ranks people best ({row['auc']:.3f}).")
    return " ".join([*parts, f"This rests on {BASIS}."])


def _tied(
    frame: pd.DataFrame, best: str, names: list[str], scoring: ScoringSettings, seed: int
) -> tuple[str, ...]:
    """Measures than which the best one is not shown better by `NEGLIGIBLE`, by an interval over persons."""
    subjects = sorted(frame["subject"].unique())
    person = np.searchsorted(subjects, frame["subject"].to_numpy(str))
    weights = person_weights(len(subjects), scoring.resamples, [seed, 3])

    def resampled(name: str) -> np.ndarray:
        return areas(sort_scores(*scores_of(frame, name, ALL_SIZES), person), weights)

    reference = resampled(best)
    differences = {name: interval(reference - resampled(name)) for name in names if name != best}
    return tuple(name for name, (low, _) in differences.items() if low < NEGLIGIBLE)


def prediction_table(contest: Contest, table: pd.DataFrame, verdict: Verdict, data: str) -> Table:
    """Return the two contests as a published table."""
    notes = [
        verdict.sentence,
        f"{contest.drawn} pushes were drawn; {contest.unsteady} of them at instants at which the simulated body would step "
        "without any push, which tests nothing: they are left out",
        "Pushes backward are larger than those forward, as the body can take more of them: a measure that knows no direction "
        "cannot tell both together, and its rows for one direction are the fair ones. Equal pushes are equal in N·s, which suits "
        "measures in N·s better than those in m",
        "The bodies have three links, a delayed controller and pushes that last; the measures know one pendulum or a posture. "
        "They share the recorded movement, masses and the markers of the feet; what the bodies can do with them (reach of the "
        "foot, strength, delay, gains, and how persons differ in these) no measure is told",
        *(f"{name}: {item.meaning}" for name, item in PREDICTORS.items() if (table["measure"] == name).any()),
    ]
    return Table(
        title="Who must step after a push: how well each measure, computed before the push, tells it.",
        frame=table,
        definitions=COLUMNS,
        data=data,
        notes=tuple(notes),
        decimals=dict.fromkeys(
            ("auc", "auc_low", "auc_high", "sensitivity_95", "failures_right", "successes_right"), 3
        ),
        may_be_empty=frozenset({"auc_low", "auc_high"}),
    )


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
    """Hold the contest with other bodies and controllers; columns `SENSITIVITY_COLUMNS`."""
    import pandas as pd

    rows = []
    cases = [("nothing", 1.0, {})]
    cases += [
        (what, factor, {field: factor}) for what, (field, factors) in VARIED.items() for factor in factors
    ]
    for what, factor, changed in cases:
        try:
            drawn = push_bodies(
                followed.motions, followed.levels, settings, seed, changed, followed.chosen, equal=False
            )
            frame = contest_of(drawn).frame
        except InputError:
            # Nobody steps any more, or everybody: there is nothing to tell.
            rows.append({"changed": what, "factor": factor, "pushes": 0})
            continue
        found = {}
        for name in contestants(ALL_SIZES):
            values, steps = scores_of(frame, name, ALL_SIZES)
            if name not in BASELINES and np.isfinite(values).all():
                found[name] = area(values, steps)
        ranking = sorted(found, key=lambda name: -found[name])
        rows.append(
            {
                "changed": what,
                "factor": factor,
                "pushes": len(frame),
                "steps": float(frame["steps"].mean()),
                "winner": ranking[0],
                "winner_auc": found[ranking[0]],
                "headline_auc": found.get(verdict.measure),
                "headline_rank": ranking.index(verdict.measure) + 1 if verdict.measure in found else None,
            }
        )
    return pd.DataFrame(rows, columns=list(SENSITIVITY_COLUMNS)).astype({"headline_rank": "Int64"})


def sensitivity_table(frame: pd.DataFrame, verdict: Verdict, data: str) -> Table:
    """Return the contests with other bodies and controllers as a published table."""
    same = int((frame["winner"] == verdict.measure).sum())
    note = (
        f"{verdict.measure} wins in {same} of {len(frame)} contests; the measures are told of none of the changes. "
        f"Only some {FOLLOWED} of the contest's pushes are followed, so that the first row differs a little from it; empty "
        "where all of them end alike"
    )
    return Table(
        title="The contest of measures with other bodies and controllers.",
        frame=frame,
        definitions=SENSITIVITY_COLUMNS,
        data=data,
        notes=(note,),
        decimals=dict.fromkeys(("steps", "winner_auc", "headline_auc"), 3),
        may_be_empty=frozenset({"steps", "winner", "winner_auc", "headline_auc", "headline_rank"}),
    )


def verdict_json(verdict: Verdict, data: str) -> dict:
    """Return the winner as other pages read it: ``pushes/winner.json``."""
    return {
        "schema": "lumbar.push_prediction/1",
        "measure": verdict.measure,
        "auc": verdict.auc,
        "auc_low": verdict.low,
        "auc_high": verdict.high,
        "not_shown_better_than": list(verdict.tied),
        "equal_pushes": verdict.equal,
        "sentence": verdict.sentence,
        "rests_on": BASIS,
        "data": data,
    }
