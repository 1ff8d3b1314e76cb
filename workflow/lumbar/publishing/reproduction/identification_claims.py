"""Sentences of Chapter 3 on surgeon motion, excitation and identified models."""

from __future__ import annotations

import pandas as pd

from lumbar.publishing.reproduction.claim import Claim, Finding, Results
from lumbar.tissue.signals.surgeon_motion import bandwidth_readings, readings_in_words

THESIS_MODELS = ("MW", "KB", "HO")


def _arx(results: Results) -> pd.DataFrame:
    table = results["table_3_1"]
    return table[(table.estimator == "arx") & table.model.isin(THESIS_MODELS) & table.stable.astype(bool)]


def _wide(results: Results, column: str) -> pd.DataFrame | None:
    """One row per training record, one column per model; None unless all three models have a value for each."""
    if column not in results["table_3_1"].columns:
        return None
    wide = _arx(results).pivot(index="trained_on", columns="model", values=column)
    if not set(THESIS_MODELS) <= set(wide.columns) or wide.isna().any(axis=None):
        return None
    return wide[list(THESIS_MODELS)]


_INCOMPLETE = Finding(None, None, "not every training record has stable MW, KB and HO models")


def _shown(wide: pd.DataFrame) -> str:
    return "; ".join(
        f"{name}: " + ", ".join(f"{model} {value:.4g}" for model, value in row.items())
        for name, row in wide.iterrows()
    )


def _ho_is(column: str, best: str):
    def judge(results: Results) -> Finding:
        wide = _wide(results, column)
        if wide is None:
            return _INCOMPLETE
        winner = wide.idxmax(axis=1) if best == "highest" else wide.idxmin(axis=1)
        return Finding(_shown(wide), bool((winner == "HO").all()))

    return judge


def _bandwidth(quantity: str):
    def judge(results: Results) -> Finding:
        readings = bandwidth_readings(results["bandwidth"])[quantity]
        near = [rule for rule, value in readings.items() if value is not None and abs(value - 2.5) <= 0.5]
        remark = f"only by: {', '.join(near)}" if 0 < len(near) < len(readings) else ""
        return Finding(readings_in_words(readings), bool(near), remark)

    return judge


def _excitation(results: Results) -> Finding:
    top = max(results["multisine"]["frequency_Hz"])
    return Finding(float(top), abs(top - 5.0) <= 0.25)


def _highest_of_all(results: Results) -> Finding:
    arx = _arx(results)
    if arx.empty:
        return _INCOMPLETE
    best = arx.loc[arx.vaf_percent.idxmax()]
    text = f"{best.model} trained on {best.trained_on}, {best.vaf_percent:.2f}"
    return Finding(text, best.model == "HO" and best.trained_on == "multisine")


def _slightly_better(results: Results) -> Finding:
    wide = _wide(results, "vaf_percent")
    if wide is None:
        return _INCOMPLETE
    gain = wide["HO"] - wide["KB"]
    text = ", ".join(f"{name} {value:.2f}" for name, value in gain.items())
    return Finding(text, bool(((gain > 0) & (gain <= 5)).all()))


def _fourth_order(results: Results) -> Finding:
    arx = _arx(results)
    found = arx[(arx.model == "HO") & (arx.trained_on == "multisine")]
    if found.empty or "biproper" not in found:
        return Finding(None, None, "no stable HO model trained on a multisine")
    row = found.iloc[0]
    text = f"order {row.order:.0f}, {'biproper' if row.biproper else 'strictly proper'}"
    return Finding(text, text == "order 4, biproper", "" if pd.isna(row.remark) else row.remark)


def _multisine_best(results: Results) -> Finding:
    wide = _wide(results, "vaf_percent")
    if wide is None or "multisine" not in wide.index or len(wide) < 2:
        return Finding(None, None, "needs models trained on a multisine and on another record")
    return Finding(_shown(wide), bool((wide.idxmax(axis=0) == "multisine").all()))


def _vaf_sorts_all(results: Results) -> Finding:
    columns = {"vaf_percent": -1, "fit_percent": -1, "nmse_train": 1}
    residual = next((name for name in _arx(results).columns if name.startswith("mean_residual_")), None)
    if residual:
        columns[residual] = 1
    orders = []
    for column, sign in columns.items():
        wide = _wide(results, column)
        if wide is None:
            return _INCOMPLETE
        orders.append((sign * wide).rank(axis=1))
    differing = [column for column, order in zip(columns, orders, strict=True) if not order.equals(orders[0])]
    return Finding("differs: " + ", ".join(differing) if differing else "same order in all", not differing)


def _maxwell(results: Results) -> Finding:
    table = results["table_3_1"]
    text = "Eq. 3.3 has the static gain b0/(1 − a0); a spring and dashpot in series have none"
    arx = table[(table.estimator == "arx") & table.model.isin(["MW", "Maxwell"])]
    pair = arx.pivot(index="trained_on", columns="model", values="vaf_percent").dropna()
    if "Maxwell" not in pair.columns:
        return Finding(text, False)
    shown = "; ".join(
        f"{name}: %VAF {row.MW:.1f} against {row.Maxwell:.1f} for the true form"
        for name, row in pair.iterrows()
    )
    return Finding(shown, False, text)


def _all_stable(results: Results) -> Finding:
    table = results["table_3_1"]
    arx = table[(table.estimator == "arx") & table.model.isin(THESIS_MODELS)]
    unstable = arx[~arx.stable.astype(bool)]
    text = ", ".join(f"{row.model} on {row.trained_on}" for row in unstable.itertuples()) or "all stable"
    return Finding(text, unstable.empty)


def _inverted(results: Results) -> Finding:
    gains = {
        model["name"]: sum(model["structure"]["numerator"]) / sum(model["structure"]["denominator"])
        for model in results["models"]["models"]
        if model["name"] in ("IL", "KB") and model["estimator"] in ("arx", "given")
    }
    if not {"IL", "KB"} <= set(gains):
        return Finding(None, None, "no IL and KB models")
    return Finding(f"static gains: IL {gains['IL']:.3g}, KB {gains['KB']:.3g}", gains["IL"] * gains["KB"] < 0)


_HO_IS = (
    ("best_vaf", "best %VAF", "vaf_percent", "highest", True),
    ("best_fit", "best FIT", "fit_percent", "highest", True),
    ("best_residual", "smallest mean residual", "mean_residual_N", "lowest", True),
    ("best_nmse_train", "best NMSE in training", "nmse_train", "lowest", False),
    ("best_nmse_test_1", "best NMSE on the first test record", "nmse_test_1", "lowest", False),
    ("best_nmse_test_2", "best NMSE on the second test record", "nmse_test_2", "lowest", False),
    ("poorest_condition", "poorest conditioning", "condition_number", "highest", True),
    ("poorest_uncertainty", "poorest relative uncertainty", "mru_percent", "highest", False),
)
"""Claim, what the HO model is said to have, column of Table 3.1, its end, and whether the twin was made to show it."""


def sentences() -> list[Claim]:
    """Return the claims of Chapter 3 up to the models."""
    table = ("table_3_1",)
    return [
        Claim("bandwidth", "3.2.3.1, 3.2.4.1", "The spectrum of the tool's position reaches up to approximately 2.5 Hz", 2.5,
              "within 0.5 Hz by one of the rules", ("bandwidth",), _bandwidth("position"), True),
        Claim("bandwidth_velocity", "3.2.4.1", "Surgeons move the tool at up to approximately 2.5 Hz: the velocity's spectrum,"
              " which the thesis does not assess", 2.5,
              "within 0.5 Hz by one of the rules", ("bandwidth",), _bandwidth("velocity"), True),
        Claim("excitation_band", "3.2.4.1", "The signals excite the tissue up to 5 Hz", 5.0,
              "highest line of the multisine within 0.25 Hz", ("multisine",), _excitation, True),
        Claim("highest_vaf", "3.2.1, 3.2.9", "The highest %VAF is that of the HO model trained on the multisine",
              "82.64", "same model and record", table, _highest_of_all, True),
        *(
            Claim(f"ho_{name}", "3.2.5", f"The HO model has the {words}", "HO", "for every training record", table,
                  _ho_is(column, best), built)
            for name, words, column, best, built in _HO_IS
        ),
        Claim("ho_slightly_better", "3.2.5", "The HO model is only slightly more accurate than the KB model",
              "1.48 points of %VAF on the multisine", "gain of 0 to 5 points for every training record", table,
              _slightly_better, True),
        Claim("ho_structure", "5", "The HO model is a biproper transfer function of fourth order", "order 4, biproper",
              "order and properness of the model trained on the multisine", table, _fourth_order),
        Claim("multisine_best", "3.2.5", "The multisine gives the best error metrics", "multisine",
              "highest %VAF of each model", table, _multisine_best),
        Claim("vaf_sorts_all", "3.2.3.1", "Sorting by %VAF gives the best results of the other metrics as well",
              "yes", "same order of models in FIT, mean residual and NMSE for every training record", table,
              _vaf_sorts_all),
        Claim("mw_is_maxwell", "3.2.3.1, Table 2.1", "Eq. 3.3 is the Maxwell model", "yes",
              "algebra: static gain of both forms", table, _maxwell),
        Claim("models_stable", "3.2.3.1", "The identified models are stable", "yes", "all poles inside the unit circle",
              table, _all_stable),
        Claim("il_opposite", "3.2.3.1", "The IL model's force is opposite to that of the other models", "opposite",
              "opposite signs of the static gains of IL and KB", ("models",), _inverted),
    ]  # fmt: skip
