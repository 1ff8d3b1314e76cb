"""Claims of Chapter 4 on basins of attraction."""

from collections.abc import Callable, Sequence
from functools import partial

import pandas as pd

from lumbar.lifting.stability.basins import RANGES, REACHES
from lumbar.lifting.stability.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import Claim, Outcome, Results, UntestableError, sentences
from lumbar.settings.lifting import GROUPS

_PERCENT = ["lateral_bending_percent", "flexion_extension_percent"]
_MISSING = "this study lacks one of the lifts compared"
_NOT_RUN = "the thesis's procedure was not run"
MAX_RATIO = 10.0
"""A basin is of the order of magnitude of its movement if it reaches at most this many times as far, and at least the
inverse."""


def basin_sentences(groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Return the claims of Chapter 4; `groups` replace the thesis's expert and novice in the statements."""
    names, (lateral, sagittal) = comparison_names(groups), _PERCENT
    between = names["expert_vs_novice"]
    lighter = [names[f"decrease_in_mass_{name}"] for name in GROUPS]
    judges = {
        "expert_larger": partial(_compared, between, lambda rows: (rows[lateral] > 0).all()),
        "lateral_largest": partial(
            _compared, between, lambda rows: (rows[lateral].abs() > rows[sagittal].abs()).all()
        ),
        "expert_unchanged": partial(
            _compared, lighter[0], lambda rows: rows[_PERCENT].abs().max(axis=None) <= 1
        ),
        "novice_susceptible": partial(_novice_susceptible, lighter, groups),
        "trajectories_matter": partial(_trajectories_matter, [between]),
        "trajectories_matter_with_mass": partial(_trajectories_matter, lighter),
        "alternation_certifies": _alternation_certifies,
        "alternation_converges": _alternation_converges,
        "basins_reach_goal": partial(_no_exits, "thesis", "Eqs 4.5 to 4.7, in the thesis's wording"),
        "exact_is_invariant": partial(
            _no_exits, "exact", "fixed V, exact ρ(t); not a sentence of the thesis"
        ),
        "basins_like_states": _basins_like_states,
        "expands_backward": _expands_backward,
    }
    return sentences("basins", judges, first=groups[0], second=groups[1], within=MAX_RATIO)


def _rows(results: Results, comparison: str) -> pd.DataFrame:
    """Return the rows of one comparison of Table 4.1 by centre of mass."""
    table = results["table_4_1"]
    rows = table[table.comparison == comparison]
    if rows.empty or rows[_PERCENT].isna().any(axis=None):
        raise UntestableError(_MISSING)
    return rows.set_index("com")


def _compared(comparison: str, agrees: Callable[[pd.DataFrame], bool], results: Results) -> Outcome:
    rows = _rows(results, comparison)
    percents = "; ".join(
        f"{com}: {row.lateral_bending_percent:+.2f} %, {row.flexion_extension_percent:+.2f} %"
        for com, row in rows.iterrows()
    )
    return Outcome(percents, bool(agrees(rows)))


def _novice_susceptible(lighter: Sequence[str], groups: tuple[str, str], results: Results) -> Outcome:
    expert, novice = (_rows(results, name)[_PERCENT].abs().mean(axis=None) for name in lighter)
    text = f"mean size of the change: {groups[0]} {expert:.2f} %, {groups[1]} {novice:.2f} %"
    return Outcome(text, bool(novice > expert))


def _trajectories_matter(names: Sequence[str], results: Results) -> Outcome:
    """Compare the headline's differences with those of its null control (θ0 = 0)."""
    rows = results["table_4_1_controls"].dropna(subset=["percent", "null_percent"])
    rows = rows[rows.comparison.isin(names)]
    if set(names) != set(rows.comparison):
        raise UntestableError(_MISSING)
    left = (rows.percent - rows.null_percent) ** 2
    sums = rows.assign(left=left, all=rows.percent**2).groupby("comparison")[["left", "all"]].sum()
    explained = 1 - sums["left"] / sums["all"]
    shares = [
        f"{name.replace('_', ' ')}: without any movement {100 * share:.0f} % of their squares are left"
        for name, share in explained.items()
    ]
    return Outcome("; ".join(shares), bool((explained < 0.5).all()))


def _basins(results: Results, method: str, absent: str) -> pd.DataFrame:
    rows = results["boa"][results["boa"].method == method]
    if rows.empty:
        raise UntestableError(absent)
    return rows


def _alternation_certifies(results: Results) -> Outcome:
    shares = 100 * _basins(results, "thesis", _NOT_RUN).violation_share
    text = f"{shares.min():.3g} to {shares.max():.3g} % of the knots violate the condition"
    return Outcome(text, bool(shares.max() == 0), "ρ̇ frozen at the previous guess is not the ρ̇ of the result")


def _alternation_converges(results: Results) -> Outcome:
    rows = _basins(results, "thesis", _NOT_RUN)
    more, fewer = (100 * (rows[f"mean_area_after_{n}"] / rows.mean_area - 1) for n in (4, 1))
    jumping = int((rows.jumped_knots > 0).sum())
    text = (
        f"with one mean areas change by {fewer.min():+.1f} to {fewer.max():+.1f} %, with four by {more.min():+.1f} to "
        f"{more.max():+.1f} %; in {jumping} of {len(rows)} basins ρ jumps at {int(rows.jumped_knots.sum())} knots in all"
    )
    remark = "only knots that have a multiplier again grow; the solver's tolerance decides which these are"
    return Outcome(text, bool(more.abs().max() <= 1), remark)


def _no_exits(method: str, remark: str, results: Results) -> Outcome:
    """Judge whether simulated starts stay in the funnels of one method."""
    rows = _basins({"boa": results["boa"].dropna(subset=["exits"])}, method, "no start was simulated")
    starts, exits = int(rows.simulated_starts.sum()), int(rows.exits.sum())
    return Outcome(f"{exits} exits in {starts} simulated starts", exits == 0, remark)


def _basins_like_states(results: Results) -> Outcome:
    """Compare each exact basin's reach with the range of its movement, for every pendulum and time.

    A state that does not move has no order of magnitude and is left out.
    """
    absent, spans, met = "no basin about a movement could be computed", [], []
    for (sign, time), rows in _basins(results, "exact", absent).groupby(["sign", "time"], sort=False):
        ratios = {
            state: (rows[reached] / rows[moved])[rows[moved] > 0]
            for state, moved, reached in zip(("angle", "velocity"), RANGES, REACHES, strict=True)
        }
        if any(ratio.empty for ratio in ratios.values()):
            continue
        met.append(all(ratio.between(1 / MAX_RATIO, MAX_RATIO).all() for ratio in ratios.values()))
        texts = (
            f"{ratio.min():.3g} to {ratio.max():.3g} times in {state}" for state, ratio in ratios.items()
        )
        spans.append(f"{sign}, {time} time: {', '.join(texts)}")
    if not met:
        raise UntestableError(absent)
    return Outcome("; ".join(spans), all(met), "Q, R and Qf are the study's, the thesis gives none")


def _expands_backward(results: Results) -> Outcome:
    rows = _basins(results, "exact", "no basin could be computed")
    larger = rows.initial_area > rows.final_area
    text = f"{int(larger.sum())} of {len(rows)} basins larger at the start than at the goal"
    return Outcome(text, bool(larger.all()))
