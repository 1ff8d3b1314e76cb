"""Sentences of Chapter 4 on basins of attraction."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pandas as pd

from lumbar.lifting.stability.basins import RANGES, REACHES
from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import Claim, Finding, Results, claims_of
from lumbar.settings.stability import GROUPS

_PERCENT = ["lateral_bending_percent", "flexion_extension_percent"]


def _rows(results: Results, comparison: str) -> pd.DataFrame | None:
    table = results["table_4_1"]
    rows = table[table.comparison == comparison]
    return None if rows.empty or rows[_PERCENT].isna().any(axis=None) else rows.set_index("com")


def _spread(rows: pd.DataFrame) -> str:
    return "; ".join(
        f"{com}: {row.lateral_bending_percent:+.2f} %, {row.flexion_extension_percent:+.2f} %"
        for com, row in rows.iterrows()
    )


_INVENTED = "the twin's lifters are invented"
_MISSING = Finding(None, None, "this study lacks one of the lifts compared")


def _judged(agrees: bool, synthetic: bool) -> tuple[bool | None, str]:
    return (None, _INVENTED) if synthetic else (bool(agrees), "")


def _compared(
    comparison: str, synthetic: bool, agrees: Callable[[pd.DataFrame], bool], results: Results
) -> Finding:
    """What the rows of one comparison of Table 4.1 show."""
    rows = _rows(results, comparison)
    return _MISSING if rows is None else Finding(_spread(rows), *_judged(agrees(rows), synthetic))


def _novice_susceptible(
    synthetic: bool, names: dict[str, str], groups: tuple[str, str], results: Results
) -> Finding:
    expert, novice = (_rows(results, names[f"decrease_in_mass_{name}"]) for name in GROUPS)
    if expert is None or novice is None:
        return _MISSING
    means = [rows[_PERCENT].abs().mean(axis=None) for rows in (expert, novice)]
    text = ", ".join(f"{name} {mean:.2f} %" for name, mean in zip(groups, means, strict=True))
    return Finding(f"mean size of the change: {text}", *_judged(means[1] > means[0], synthetic))


def _trajectories_matter(synthetic: bool, names: Sequence[str], results: Results) -> Finding:
    """Compare the headline's differences with those of its null control (θ0 = 0)."""
    rows = results["table_4_1_controls"].dropna(subset=["percent", "null_percent"])
    rows = rows[rows.comparison.isin(names)]
    if set(names) != set(rows.comparison):
        return _MISSING
    left = (rows.percent - rows.null_percent) ** 2
    sums = rows.assign(left=left, all=rows.percent**2).groupby("comparison")[["left", "all"]].sum()
    explained = 1 - sums["left"] / sums["all"]
    words = [
        f"{name.replace('_', ' ')}: without any movement {100 * share:.0f} % of their squares are left"
        for name, share in explained.items()
    ]
    agrees, remark = _judged(bool((explained < 0.5).all()), synthetic)
    return Finding("; ".join(words), agrees, remark and f"cannot be tested on invented lifters: {remark}")


def _alternation_certifies(results: Results) -> Finding:
    rows = results["boa"][results["boa"].method == "thesis"]
    if rows.empty:
        return Finding(None, None, "the thesis's procedure was not run")
    worst = 100 * float(rows.violation_share.max())
    least = 100 * float(rows.violation_share.min())
    text = f"{least:.3g} to {worst:.3g} % of the knots violate the condition"
    return Finding(text, worst == 0, "ρ̇ frozen at the previous guess is not the ρ̇ of the result")


def _alternation_converges(results: Results) -> Finding:
    rows = results["boa"][results["boa"].method == "thesis"]
    if rows.empty:
        return Finding(None, None, "the thesis's procedure was not run")
    more, fewer = (100 * (rows[f"mean_area_after_{n}"] / rows.mean_area - 1) for n in (4, 1))
    jumping = int((rows.jumped_knots > 0).sum())
    text = (
        f"with one mean areas change by {fewer.min():+.1f} to {fewer.max():+.1f} %, with four by {more.min():+.1f} to "
        f"{more.max():+.1f} %; in {jumping} of {len(rows)} basins ρ jumps at {int(rows.jumped_knots.sum())} knots in all"
    )
    return Finding(
        text,
        bool(more.abs().max() <= 1),
        "knots that have a multiplier again grow alone; which they are hangs on the tolerance of a solver",
    )


def _no_exits(method: str, remark: str, results: Results) -> Finding:
    """What simulated starts do in the funnels of one method."""
    rows = results["boa"][results["boa"].method == method].dropna(subset=["exits"])
    if rows.empty:
        return Finding(None, None, "no start was simulated")
    starts, exits = int(rows.simulated_starts.sum()), int(rows.exits.sum())
    return Finding(f"{exits} exits in {starts} simulated starts", exits == 0, remark)


WITHIN = 10.0
"""A basin is of the order of magnitude of its movement if it reaches at most so many times as far, and at least 1/`WITHIN`."""


def reach_ratios(boa: pd.DataFrame) -> dict[str, np.ndarray]:
    """How many times the range of its movement each exact basin of ``boa.csv`` reaches from the trajectory, by state.

    A state that does not move has no order of magnitude and is left out.
    """
    rows = boa[boa["method"] == "exact"]
    found = {}
    for state, moved, reached in zip(("angle", "velocity"), RANGES, REACHES, strict=True):
        moves = rows[rows[moved] > 0]
        found[state] = (moves[reached] / moves[moved]).to_numpy(float)
    return found


def is_met(ratios: np.ndarray) -> bool:
    """Whether basins are of the order of magnitude of the states."""
    return bool((ratios <= WITHIN).all() and (ratios >= 1 / WITHIN).all())


def span(ratios: np.ndarray) -> str:
    """Say from how many to how many times."""
    return f"{ratios.min():.3g} to {ratios.max():.3g}"


def _basins_like_states(results: Results) -> Finding:
    """Judge the thesis's criterion for Q and R on the exact basins of every wording."""
    rows, words, met = results["boa"][results["boa"].method == "exact"], [], []
    for (sign, time), own in rows.groupby(["sign", "time"], sort=False):
        ratios = reach_ratios(own)
        if all(found.size for found in ratios.values()):
            met.append(all(map(is_met, ratios.values())))
            spans = ", ".join(f"{span(found)} times in {state}" for state, found in ratios.items())
            words.append(f"{sign}, {time} time: {spans}")
    if not met:
        return Finding(None, None, "no basin about a movement could be computed")
    remark = "Q, R and Qf are the study's, the thesis gives none"
    return Finding("; ".join(words), all(met), remark)


def _expands_backward(results: Results) -> Finding:
    rows = results["boa"][results["boa"].method == "exact"]
    if rows.empty:
        return Finding(None, None, "no basin could be computed")
    larger = rows.initial_area > rows.final_area
    text = f"{int(larger.sum())} of {len(rows)} basins larger at the start than at the goal"
    return Finding(text, bool(larger.all()))


def sentences(synthetic: bool, groups: tuple[str, str] = GROUPS) -> list[Claim]:
    """Return the claims of Chapter 4.

    Parameters
    ----------
    synthetic : bool
        Whether the lifters are the twin's: what concerns persons then cannot be tested.
    groups : tuple of str
        Whom the study compares in place of the thesis's expert and novice; the statements use these names.
    """
    names, (first, second) = comparison_names(groups), groups
    between, (lateral, sagittal) = names["expert_vs_novice"], _PERCENT
    lighter = {name: names[f"decrease_in_mass_{name}"] for name in GROUPS}
    judges = {
        "expert_larger": partial(_compared, between, synthetic, lambda rows: (rows[lateral] > 0).all()),
        "lateral_largest": partial(
            _compared, between, synthetic, lambda rows: (rows[lateral].abs() > rows[sagittal].abs()).all()
        ),
        "expert_unchanged": partial(
            _compared, lighter["expert"], synthetic, lambda rows: rows[_PERCENT].abs().max(axis=None) <= 1
        ),
        "novice_susceptible": partial(_novice_susceptible, synthetic, names, groups),
        "trajectories_matter": partial(_trajectories_matter, synthetic, [between]),
        "trajectories_matter_with_mass": partial(_trajectories_matter, synthetic, list(lighter.values())),
        "alternation_certifies": _alternation_certifies,
        "alternation_converges": _alternation_converges,
        "basins_reach_goal": partial(_no_exits, "thesis", "Eqs 4.5 to 4.7, in the thesis's wording"),
        "exact_is_invariant": partial(
            _no_exits, "exact", "fixed V, exact ρ(t); not a sentence of the thesis"
        ),
        "basins_like_states": _basins_like_states,
        "expands_backward": _expands_backward,
    }
    return claims_of("basins", judges, first=first, second=second, within=WITHIN)
