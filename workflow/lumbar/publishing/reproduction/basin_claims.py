"""Sentences of Chapter 4 on basins of attraction."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pandas as pd

from lumbar.lifting.stability.comparison.percent_differences import comparison_names
from lumbar.lifting.stability.comparison.table_4_1_grid import comparison_cells, expressing
from lumbar.lifting.stability.comparison.tuning_criterion import WITHIN, is_met, reach_ratios, span
from lumbar.publishing.reproduction.claim import Claim, Finding, Results
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


def _compared(comparison: str, synthetic: bool, agrees: Callable[[pd.DataFrame], bool]):
    """What the rows of one comparison of Table 4.1 show."""

    def judge(results: Results) -> Finding:
        rows = _rows(results, comparison)
        return _MISSING if rows is None else Finding(_spread(rows), *_judged(agrees(rows), synthetic))

    return judge


def _positive_in_bending(rows: pd.DataFrame) -> bool:
    return (rows.lateral_bending_percent > 0).all()


def _larger_in_bending(rows: pd.DataFrame) -> bool:
    return (rows.lateral_bending_percent.abs() > rows.flexion_extension_percent.abs()).all()


def _at_most_1(rows: pd.DataFrame) -> bool:
    return rows[_PERCENT].abs().max(axis=None) <= 1


def _novice_susceptible(synthetic: bool, names: dict[str, str], groups: tuple[str, str]):
    def judge(results: Results) -> Finding:
        expert, novice = (_rows(results, names[f"decrease_in_mass_{name}"]) for name in GROUPS)
        if expert is None or novice is None:
            return _MISSING
        means = [rows[_PERCENT].abs().mean(axis=None) for rows in (expert, novice)]
        text = ", ".join(f"{name} {mean:.2f} %" for name, mean in zip(groups, means, strict=True))
        return Finding(f"mean size of the change: {text}", *_judged(means[1] > means[0], synthetic))

    return judge


def _trajectories_matter(synthetic: bool, names: Sequence[str]):
    """Compare differences with those of the null control (θ0 = 0), by sign of gravity, over the grid that expresses them."""

    def judge(results: Results) -> Finding:
        cells = expressing(comparison_cells(results["table_4_1_grid"]))
        cells = cells[cells.comparison.isin(names)]
        if set(names) != set(cells.comparison):
            return _MISSING
        left = (cells.percent - cells.null_percent) ** 2
        sums = (
            cells.assign(left=left, all=cells.percent**2)
            .groupby(["comparison", "sign"])[["left", "all"]]
            .sum()
        )
        explained = 1 - sums["left"] / sums["all"]
        words = [
            f"{name.replace('_', ' ')}, {sign}: without any movement {100 * share:.0f} % of their squares are left"
            for (name, sign), share in explained.items()
        ]
        # A person stands: the inverted sign decides; the published one stands beside it.
        inverted = explained[explained.index.get_level_values("sign") == "inverted"]
        agrees, remark = _judged(bool((inverted < 0.5).all()) and len(inverted) == len(names), synthetic)
        return Finding("; ".join(words), agrees, remark and f"cannot be tested on invented lifters: {remark}")

    return judge


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


def _no_exits(method: str, remark: str):
    """What simulated starts do in the funnels of one method."""

    def judge(results: Results) -> Finding:
        rows = results["boa"][results["boa"].method == method].dropna(subset=["exits"])
        if rows.empty:
            return Finding(None, None, "no start was simulated")
        starts, exits = int(rows.simulated_starts.sum()), int(rows.exits.sum())
        return Finding(f"{exits} exits in {starts} simulated starts", exits == 0, remark)

    return judge


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
    remark = "Q, R and Qf are the study's, the thesis gives none; table_4_1_controls has such as meet it"
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
    table, areas, names = ("table_4_1",), ("boa",), comparison_names(groups)
    first, second = groups
    between = names["expert_vs_novice"]
    return [
        Claim("expert_larger", "4.2.5", f"The {first}'s basins are larger than the {second}'s in lateral bending",
              "2.27 to 4.44 %", "positive for all three COMs", table,
              _compared(between, synthetic, _positive_in_bending)),
        Claim("lateral_largest", "4.2.5", "The largest differences are in lateral bending", "lateral bending",
              "larger than in flexion/extension for all three COMs", table,
              _compared(between, synthetic, _larger_in_bending)),
        Claim("expert_unchanged", "4.2.5", f"A lighter box hardly changes the {first}'s basins", "−0.87 to 0.07 %",
              "at most 1 % for every COM and plane", table,
              _compared(names["decrease_in_mass_expert"], synthetic, _at_most_1)),
        Claim("novice_susceptible", "4.2.1, 4.2.5", f"The {second} is more susceptible to changes of the box's mass",
              "up to 7.51 %", f"mean size of the change larger than the {first}'s", table,
              _novice_susceptible(synthetic, names, groups)),
        Claim("trajectories_matter", "4.2.1, 4.2.6",
              f"The differences between {first} and {second} come from the trajectories they select", "yes",
              "as people stand, less than half is left when every trajectory is replaced by θ0 = 0",
              ("table_4_1_grid",), _trajectories_matter(synthetic, [between])),
        Claim("trajectories_matter_with_mass", "4.2.1, 4.2.6",
              "The differences between boxes come from the trajectories selected for them", "yes",
              f"the same of both changes of mass, the {first}'s and the {second}'s", ("table_4_1_grid",),
              _trajectories_matter(synthetic, [names[f"decrease_in_mass_{name}"] for name in GROUPS])),
        Claim("alternation_certifies", "4.2.5", "The sum-of-squares programmes certify that the basins are invariant",
              "yes", "no knot of the thesis's procedure violates Eq. 4.6", areas, _alternation_certifies),
        Claim("alternation_converges", "4.2.4", "Two alternations give the average cross-section", "two alternations",
              "four change no average area by more than 1 %", areas, _alternation_converges),
        Claim("basins_reach_goal", "4.2.5", "Simulation confirms that the basins reach the goal", "proposed as future work",
              "no simulated start leaves a funnel of the thesis's procedure", areas,
              _no_exits("thesis", "Eqs 4.5 to 4.7, in the thesis's wording")),
        Claim("exact_is_invariant", "4.2.5", "Basins with the exact ρ(t) reach the goal", "proposed as future work",
              "no simulated start leaves the exact funnel, which stands beside the thesis's", areas,
              _no_exits("exact", "fixed V, exact ρ(t); not a sentence of the thesis")),
        Claim("basins_like_states", "4.2.3.2, 4.2.5",
              "Q and R are such that basins are of the order of magnitude of the states", "Figure 4.3",
              f"every basin reaches at most {WITHIN:g} times as far from the trajectory as its movement ranges, and a "
              "tenth at least, in angle and velocity", areas, _basins_like_states),
        Claim("expands_backward", "4.2.4", "The basin expands away from the goal set", "Figure 4.3",
              "initial area above final area for every basin", areas, _expands_backward),
    ]  # fmt: skip
