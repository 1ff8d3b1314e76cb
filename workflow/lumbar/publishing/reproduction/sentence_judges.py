"""Judges of the sentences of Chapter 3 (surgeons, excitation, identified models, survey) and Chapter 4 (basins of attraction).

The reconstructed survey was made from the published margins: claims that follow from the margins are built in, and claims that
need the pairing of one participant's answers are not.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import pandas as pd

from lumbar.lifting.stability.basins import RANGES, REACHES
from lumbar.lifting.stability.percent_differences import comparison_names
from lumbar.publishing.reproduction.claim import Outcome, Results, UntestableError
from lumbar.settings.lifting import GROUPS
from lumbar.tissue.signals.surgeon_motion import bandwidth_readings, readings_in_words, summation_in_words

THESIS_MODELS = ("MW", "KB", "HO")
_JUDGES: dict[str, Callable[[Results], Outcome]] = {}
"""Judges without parameters by claim."""


def _register_judge(claim: str) -> Callable:
    """Return a decorator that registers a function as the judge of a claim."""
    return lambda function: _JUDGES.setdefault(claim, function)


_NO_MODELS = "not every training record has stable MW, KB and HO models"


def _select_arx_rows(results: Results) -> pd.DataFrame:
    """Return the rows of Table 3.1 for stable ARX models of the thesis."""
    table = results["table_3_1"]
    return table[(table.estimator == "arx") & table.model.isin(THESIS_MODELS) & table.stable.astype(bool)]


def _pivot_column(results: Results, column: str) -> pd.DataFrame:
    """Return a column of Table 3.1 by training record (rows) and model (columns); every model needs a value per record."""
    if column in results["table_3_1"].columns:
        wide = _select_arx_rows(results).pivot(index="trained_on", columns="model", values=column)
        if set(THESIS_MODELS) <= set(wide.columns) and not wide.isna().any(axis=None):
            return wide[list(THESIS_MODELS)]
    raise UntestableError(_NO_MODELS)


def _format_wide(wide: pd.DataFrame) -> str:
    return "; ".join(
        f"{name}: " + ", ".join(f"{model} {value:.4g}" for model, value in row.items())
        for name, row in wide.iterrows()
    )


def _judge_ho_extreme(column: str, end: str, results: Results) -> Outcome:
    wide = _pivot_column(results, column)
    winner = wide.idxmax(axis=1) if end == "highest" else wide.idxmin(axis=1)
    nested = _records_with_nested_kb(results) if column in ("nmse_train", "condition_number") else []
    remark = (
        f"by algebra on {', '.join(nested)}: all regressors of KB are among those of HO" if nested else ""
    )
    return Outcome(_format_wide(wide), bool((winner == "HO").all()), remark, set(nested) == set(wide.index))


def _records_with_nested_kb(results: Results) -> list[str]:
    """Return the training records on which HO has all regressors of KB: y[k − 1], u[k] and u[k − 1].

    On these no data can give HO the larger training NMSE at α = 0, since KB is HO with coefficients of zero (a ridge loosens the
    bound by α²‖x‖²/N), or the smaller condition number, since columns added to A neither lower its largest nor raise its
    smallest singular value. A strictly proper HO has no u[k].
    """
    arx = _select_arx_rows(results)
    if not {"biproper", "parameters"} <= set(arx.columns):
        return []
    higher = arx[(arx.model == "HO") & arx.biproper.astype(bool) & (arx.parameters - arx.order >= 2)]
    return sorted(higher.trained_on)


def _judge_bandwidth(quantity: str, results: Results) -> Outcome:
    bandwidths = results["bandwidth"]
    value = bandwidths[quantity]["power_share"]["value_Hz"]
    text = readings_in_words(bandwidth_readings(bandwidths)[quantity])
    return Outcome(text, abs(value - 2.5) <= 0.5, summation_in_words(bandwidths))


def _judge_shares(group: str, thesis: float, results: Results) -> Outcome:
    """Compare the share of a group of participants in percent (or, for an empty group, their number) with the thesis's value."""
    participants = results["survey"]["participants"]
    if not group:
        return Outcome(participants["number"], participants["number"] == thesis)
    row = participants["groups"].get(group) or participants["experience"].get(group)
    if row is None:
        raise UntestableError("the survey's table has no such group")
    percent = round(row["percent"], 1)
    return Outcome(percent, abs(percent - thesis) <= 0.051)


@_register_judge("excitation_band")
def _judge_excitation_band(results: Results) -> Outcome:
    highest = float(max(results["multisine"]["frequency_Hz"]))
    return Outcome(highest, abs(highest - 5.0) <= 0.25)


@_register_judge("highest_vaf")
def _judge_highest_vaf(results: Results) -> Outcome:
    arx = _select_arx_rows(results)
    if arx.empty:
        raise UntestableError(_NO_MODELS)
    best = arx.loc[arx.vaf_percent.idxmax()]
    text = f"{best.model} trained on {best.trained_on}, {best.vaf_percent:.2f}"
    return Outcome(text, best.model == "HO" and best.trained_on == "multisine")


@_register_judge("ho_slightly_better")
def _judge_gain_of_ho(results: Results) -> Outcome:
    wide = _pivot_column(results, "vaf_percent")
    gain = wide["HO"] - wide["KB"]
    shares = 100 * gain / (100 - wide["KB"])
    text = ", ".join(f"{name} {gain[name]:.2f} points, {share:.0f} %" for name, share in shares.items())
    return Outcome(text, bool(shares.between(0, 10).all()))


@_register_judge("ho_structure")
def _judge_order_of_ho(results: Results) -> Outcome:
    arx = _select_arx_rows(results)
    higher = arx[(arx.model == "HO") & (arx.trained_on == "multisine")]
    if higher.empty or "biproper" not in higher:
        raise UntestableError("no stable HO model trained on a multisine")
    row = higher.iloc[0]
    text = f"order {row.order:.0f}, {'biproper' if row.biproper else 'strictly proper'}"
    return Outcome(text, text == "order 4, biproper", "" if pd.isna(row.remark) else row.remark)


@_register_judge("multisine_best")
def _judge_multisine(results: Results) -> Outcome:
    wide = _pivot_column(results, "vaf_percent")
    if "multisine" not in wide.index or len(wide) < 2:
        raise UntestableError("needs models trained on a multisine and on another record")
    return Outcome(_format_wide(wide), bool((wide.idxmax(axis=0) == "multisine").all()))


@_register_judge("vaf_sorts_all")
def _judge_orders(results: Results) -> Outcome:
    residuals = [name for name in _select_arx_rows(results).columns if name.startswith("mean_residual_")]
    signs = {"vaf_percent": -1, "fit_percent": -1, "nmse_train": 1, **dict.fromkeys(residuals[:1], 1)}
    orders = {column: (sign * _pivot_column(results, column)).rank(axis=1) for column, sign in signs.items()}
    differing = [column for column, order in orders.items() if not order.equals(orders["vaf_percent"])]
    text = "differs: " + ", ".join(differing) if differing else "same order in all"
    return Outcome(text, not differing, "of FIT by algebra, where errors have no mean")


@_register_judge("mw_is_maxwell")
def _judge_maxwell_form(results: Results) -> Outcome:
    table = results["table_3_1"]
    text = "Eq. 3.3 has the static gain b0/(1 − a0); a spring and dashpot in series have none"
    arx = table[(table.estimator == "arx") & table.model.isin(["MW", "Maxwell"])]
    pair = arx.pivot(index="trained_on", columns="model", values="vaf_percent").dropna()
    if "Maxwell" not in pair.columns:
        return Outcome(text, False)
    rows = (
        f"{row.Index}: %VAF {row.MW:.1f} against {row.Maxwell:.1f} for the true form"
        for row in pair.itertuples()
    )
    return Outcome("; ".join(rows), False, text)


@_register_judge("models_stable")
def _judge_stability(results: Results) -> Outcome:
    table = results["table_3_1"]
    arx = table[(table.estimator == "arx") & table.model.isin(THESIS_MODELS)]
    unstable = arx[~arx.stable.astype(bool)]
    text = ", ".join(f"{row.model} on {row.trained_on}" for row in unstable.itertuples()) or "all stable"
    return Outcome(text, unstable.empty)


@_register_judge("il_opposite")
def _judge_sign_of_il(results: Results) -> Outcome:
    gains = {
        model["name"]: sum(model["structure"]["numerator"]) / sum(model["structure"]["denominator"])
        for model in results["models"]["models"]
        if model["name"] in ("IL", "KB") and model["estimator"] in ("arx", "given")
    }
    if not {"IL", "KB"} <= set(gains):
        raise UntestableError("no IL and KB models")
    text = f"static gains: IL {gains['IL']:.3g}, KB {gains['KB']:.3g}"
    remark = "IL is made so, and every elastic tissue gives KB a positive gain"
    return Outcome(text, gains["IL"] * gains["KB"] < 0, remark, by_definition=True)


_HO_EXTREMES = {
    "best_vaf": ("vaf_percent", "highest"),
    "best_fit": ("fit_percent", "highest"),
    "best_residual": ("mean_residual_N", "lowest"),
    "best_nmse_train": ("nmse_train", "lowest"),
    "best_nmse_test_1": ("nmse_test_1", "lowest"),
    "best_nmse_test_2": ("nmse_test_2", "lowest"),
    "poorest_condition": ("condition_number", "highest"),
    "poorest_uncertainty": ("mru_percent", "highest"),
}
"""Column of Table 3.1 and extreme of the HO model in it, ``highest`` or ``lowest``, by claim."""


@_register_judge("kruskal_wallis")
def _judge_kruskal_wallis(results: Results) -> Outcome:
    test = results["survey"]["kruskal_wallis"]
    return Outcome(f"H {test['statistic']:.2f}, p {test['p_value']:.1e}", test["p_value"] < 0.05)


def _judge_pairs(key: str, test: str, results: Results) -> Outcome:
    """Judge whether a test distinguishes all pairs of models except KB and HO."""
    p_values = {frozenset((row["first"], row["second"])): row[key] for row in results["survey"][test]}
    exempt = p_values.pop(frozenset(("KB", "HO")), None)
    if exempt is None or not p_values:
        raise UntestableError("KB and HO were not both rated")
    text = f"largest of the others {max(p_values.values()):.2g}; KB and HO {exempt:.2g}"
    return Outcome(text, max(p_values.values()) < 0.05 <= exempt)


@_register_judge("pairs_differ_paired")
def _judge_paired_tests(results: Results) -> Outcome:
    found, dropped = (_judge_pairs(key, "wilcoxon", results) for key in ("p_holm", "p_holm_without_zeros"))
    value = f"zero differences ranked: {found.value}; dropped: {dropped.value}"
    if any("reconstructed" in source for source in results["survey"]["participants"]["sources"]):
        return Outcome(value, None, "the pairing of the reconstructed answers is not real")
    if found.agrees != dropped.agrees:
        return Outcome(value, None, "it depends on how zero differences are treated")
    return Outcome(value, found.agrees)


def _judge_best_pick(which: str, model: str, results: Results) -> Outcome:
    picks = {name: entry["percent"] for name, entry in results["survey"]["best_picks"].items()}
    chosen = max(picks, key=picks.get) if which == "highest" else min(picks, key=picks.get)
    return Outcome(", ".join(f"{name} {value:.1f} %" for name, value in picks.items()), chosen == model)


@_register_judge("picks_separate")
def _judge_equal_picks(results: Results) -> Outcome:
    test = results["survey"]["equal_shares"]["without_baseline"]
    if test is None:
        raise UntestableError("too few models were picked")
    return Outcome(f"chi-square p {test['p_value']:.2f} among MW, KB, HO", test["p_value"] < 0.05)


@_register_judge("highest_median_mode")
def _judge_median_and_mode(results: Results) -> Outcome:
    table = results["table_3_2"].set_index("model")[["median", "mode"]]
    text = ", ".join(f"{row.Index} {row.median:g}/{row.mode:g}" for row in table.itertuples())
    agrees = all(set(table.index[column == column.max()]) == {"KB", "HO"} for _, column in table.items())
    return Outcome(text, agrees)


@_register_judge("mode_count")
def _judge_mode_count(results: Results) -> Outcome:
    counts = results["table_3_2"].set_index("model")["mode_count"]
    if not {"HO", "KB"} <= set(counts.index):
        raise UntestableError("KB and HO were not both rated")
    return Outcome(f"HO {counts['HO']}, KB {counts['KB']}", bool(counts["HO"] > counts["KB"]))


@_register_judge("closer_is_preferred")
def _judge_preference(results: Results) -> Outcome:
    table = results["table_3_1"]
    arx = table[(table.estimator == "arx") & (table.trained_on == "multisine")].set_index("model").vaf_percent
    ratings = results["table_3_2"].set_index("model")["median"]
    models = [model for model in ("MW", "KB", "HO") if model in arx.index and model in ratings.index]
    if len(models) < 3:
        raise UntestableError("needs MW, KB and HO trained on the multisine")
    by_accuracy = sorted(models, key=lambda model: arx[model])
    rising = all(ratings[low] <= ratings[high] for low, high in pairwise(by_accuracy))
    text = ", ".join(f"{model}: %VAF {arx[model]:.1f}, median {ratings[model]:g}" for model in by_accuracy)
    return Outcome(text, rising, "three models: an order that chance gives in one case of six or more")


_PERCENT = ["lateral_bending_percent", "flexion_extension_percent"]
_MISSING = "this study lacks one of the lifts compared"
_NOT_RUN = "the thesis's procedure was not run"
MAX_RATIO = 10.0
"""Largest ratio, and inverse of the least ratio, of sizes of basin and movement for equal orders of magnitude."""


def _rows(results: Results, comparison: str) -> pd.DataFrame:
    """Return the rows of one comparison of Table 4.1 by centre of mass."""
    table = results["table_4_1"]
    rows = table[table.comparison == comparison]
    if rows.empty or rows[_PERCENT].isna().any(axis=None):
        raise UntestableError(_MISSING)
    return rows.set_index("com")


def _judge_comparison(comparison: str, agrees: Callable[[pd.DataFrame], bool], results: Results) -> Outcome:
    rows = _rows(results, comparison)
    percents = "; ".join(
        f"{com}: {row.lateral_bending_percent:+.2f} %, {row.flexion_extension_percent:+.2f} %"
        for com, row in rows.iterrows()
    )
    return Outcome(percents, bool(agrees(rows)))


def _judge_susceptibility(lighter: Sequence[str], groups: tuple[str, str], results: Results) -> Outcome:
    expert, novice = (_rows(results, name)[_PERCENT].abs().mean(axis=None) for name in lighter)
    text = f"mean size of the change: {groups[0]} {expert:.2f} %, {groups[1]} {novice:.2f} %"
    return Outcome(text, bool(novice > expert))


def _judge_null_control(names: Sequence[str], results: Results) -> Outcome:
    """Compare the headline's differences with the differences of its null control (θ0 = 0)."""
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


@_register_judge("alternation_certifies")
def _judge_certificates(results: Results) -> Outcome:
    shares = 100 * _basins(results, "thesis", _NOT_RUN).violation_share
    text = f"{shares.min():.3g} to {shares.max():.3g} % of the knots violate the condition"
    return Outcome(text, bool(shares.max() == 0), "ρ̇ frozen at the previous guess is not the ρ̇ of the result")


@_register_judge("alternation_converges")
def _judge_convergence(results: Results) -> Outcome:
    rows = _basins(results, "thesis", _NOT_RUN)
    more, fewer = (100 * (rows[f"mean_area_after_{n}"] / rows.mean_area - 1) for n in (4, 1))
    jumping = int((rows.jumped_knots > 0).sum())
    text = (
        f"with one mean areas change by {fewer.min():+.1f} to {fewer.max():+.1f} %, with four by {more.min():+.1f} to "
        f"{more.max():+.1f} %; in {jumping} of {len(rows)} basins ρ jumps at {int(rows.jumped_knots.sum())} knots in all"
    )
    remark = "only knots that have a multiplier again grow; the solver's tolerance decides which these are"
    return Outcome(text, bool(more.abs().max() <= 1), remark)


def _judge_exits(method: str, remark: str, results: Results) -> Outcome:
    """Judge whether simulated starts stay in the funnels of one method."""
    rows = _basins({"boa": results["boa"].dropna(subset=["exits"])}, method, "no start was simulated")
    starts, exits = int(rows.simulated_starts.sum()), int(rows.exits.sum())
    return Outcome(f"{exits} exits in {starts} simulated starts", exits == 0, remark)


@_register_judge("basins_like_states")
def _judge_basin_sizes(results: Results) -> Outcome:
    """Compare the size of each exact basin with the range of its movement, for every sign and time.

    A state that does not change has no order of magnitude and is left out.
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


@_register_judge("expands_backward")
def _judge_expansion(results: Results) -> Outcome:
    rows = _basins(results, "exact", "no basin could be computed")
    larger = rows.initial_area > rows.final_area
    text = f"{int(larger.sum())} of {len(rows)} basins larger at the start than at the goal"
    return Outcome(text, bool(larger.all()))


def judges_of_sentences(groups: tuple[str, str]) -> dict[str, Callable[[Results], Outcome]]:
    """Return the judge of every claim of ``claims.yaml``; `groups` replace the thesis's expert and novice."""
    names, (lateral, sagittal) = comparison_names(groups), _PERCENT
    between, lighter = names["expert_vs_novice"], [names[f"decrease_in_mass_{name}"] for name in GROUPS]
    shares = {"clinician": 75.6, "dry_needling": 15.6, "acupuncture": 13.3, "palpation": 93.3}
    shares |= {"<5": 11.1, ">20": 35.6}
    return {
        **_JUDGES,
        "bandwidth": partial(_judge_bandwidth, "position"),
        "bandwidth_velocity": partial(_judge_bandwidth, "velocity"),
        **{f"ho_{name}": partial(_judge_ho_extreme, *column) for name, column in _HO_EXTREMES.items()},
        "participants": partial(_judge_shares, "", 45),
        **{f"participants.{group}": partial(_judge_shares, group, share) for group, share in shares.items()},
        "pairs_differ": partial(_judge_pairs, "p_value", "mann_whitney"),
        "pairs_differ_holm": partial(_judge_pairs, "p_holm", "mann_whitney"),
        "best_ho": partial(_judge_best_pick, "highest", "HO"),
        "best_il": partial(_judge_best_pick, "lowest", "IL"),
        "expert_larger": partial(_judge_comparison, between, lambda rows: (rows[lateral] > 0).all()),
        "lateral_largest": partial(
            _judge_comparison, between, lambda rows: (rows[lateral].abs() > rows[sagittal].abs()).all()
        ),
        "expert_unchanged": partial(
            _judge_comparison, lighter[0], lambda rows: rows[_PERCENT].abs().max(axis=None) <= 1
        ),
        "novice_susceptible": partial(_judge_susceptibility, lighter, groups),
        "trajectories_matter": partial(_judge_null_control, [between]),
        "trajectories_matter_with_mass": partial(_judge_null_control, lighter),
        "basins_reach_goal": partial(_judge_exits, "thesis", "Eqs 4.5 to 4.7, in the thesis's wording"),
        "exact_is_invariant": partial(
            _judge_exits, "exact", "fixed V, exact ρ(t); not a sentence of the thesis"
        ),
    }
