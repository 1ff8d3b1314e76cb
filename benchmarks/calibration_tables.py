"""Shares and their tables for `calibration.py`: false alarms by condition, and the coverage of intervals."""

from __future__ import annotations

import numpy as np
import pandas as pd

from calibration_records import CONDITIONS
from hidden_effects.scores import share_with_interval

CONFIDENCE = 0.95
WHITE, COLOURED = "white", "coloured"


def format_share(successes: int, trials: int) -> str:
    """Format a share with Wilson's interval."""
    interval = share_with_interval(successes, trials, CONFIDENCE)
    low, high = interval["low_percent"], interval["high_percent"]
    return f"{interval['share_percent']:.1f} % ({low:.1f}–{high:.1f})"


def null_lines(nulls: pd.DataFrame) -> list[str]:
    """Table of the nulls: a row per condition, then all."""
    lines = [
        "| nothing hidden, under | experiments | an effect named | called unexplained | p ≤ 0.05 | p ≤ 0.01 |",
        "|---|---|---|---|---|---|",
    ]
    groups = [(name, nulls[nulls["condition"] == name]) for name in CONDITIONS]
    for name, own in [*groups, ("all", nulls)]:
        if own.empty:
            continue
        counts = [
            (own["verdict"] == "unexplained").sum(),
            *((own["p_value"] <= p).sum() for p in (0.05, 0.01)),
        ]
        named = named_share(own)
        lines.append(f"| {name} | {len(own)} | {named} | {' | '.join(map(str, counts))} |")
    return lines


def named_share(nulls: pd.DataFrame) -> str:
    """Number of experiments in which an effect is named, with the share's interval."""
    count = int((nulls["named"] != "").sum())
    return f"{count}: {format_share(count, len(nulls))}"


def coverage(intervals: pd.DataFrame) -> pd.DataFrame:
    """Return the coverage of the intervals of each parameter under white, coloured and any noise.

    Parameters
    ----------
    intervals : pandas.DataFrame
        One row per fitted parameter, as in ``calibration_intervals.csv``; rows of refused fits have no parameter.

    Returns
    -------
    pandas.DataFrame
        Columns ``owner`` (empty for the base's parameters, which all experiments share), ``parameter``, ``noise`` (white,
        coloured, all), ``held``, ``count`` and ``bias``, the median error in standard errors: of (value − true) over half the
        interval's width / 1.96.
    """
    known = intervals.dropna(subset=["parameter"]).assign(owner=lambda frame: frame["owner"].fillna(""))
    known = known.assign(
        held=(known["low"] <= known["true"]) & (known["true"] <= known["high"]),
        off=(known["value"] - known["true"]) / ((known["high"] - known["low"]) / (2 * 1.96)),
        colour=np.where(known["noise"] == WHITE, WHITE, COLOURED),
    )
    known = known.sort_values("owner", key=lambda owner: owner != "", kind="stable")
    rows = []
    for (owner, parameter), own in known.groupby(["owner", "parameter"], sort=False):
        for noise in (WHITE, COLOURED, "all"):
            part = own if noise == "all" else own[own["colour"] == noise]
            sizes = {"held": int(part["held"].sum()), "count": len(part), "bias": float(part["off"].median())}
            rows.append({"owner": owner, "parameter": parameter, "noise": noise, **sizes})
    return pd.DataFrame(rows)


def coverage_lines(covered: pd.DataFrame) -> list[str]:
    """Table of the intervals: a row per parameter, those of the base first."""
    lines = [
        "| parameter | experiments | white noise | AR(1) and 1/f noise | all | median error, in standard errors |",
        "|---|---|---|---|---|---|",
    ]
    for (owner, parameter), own in covered.groupby(["owner", "parameter"], sort=False):
        by_noise = own.set_index("noise")
        shares = [
            format_share(*by_noise.loc[noise, ["held", "count"]].astype(int)) for noise in by_noise.index
        ]
        whole = by_noise.loc["all"]
        lines.append(
            f"| {parameter_words(owner, parameter)} | {whole['count']} | {' | '.join(shares)} | {whole['bias']:+.2f} |"
        )
    return lines


def parameter_words(owner: str, parameter: str) -> str:
    """Format the owner of a parameter, and the parameter if it has another name."""
    return (parameter if owner == parameter else f"{owner or 'base'}: {parameter}").replace("_", " ")
