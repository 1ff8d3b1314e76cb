"""Picture of `calibration.py`: how often p-values are as small as they are, and intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import binom, binomtest

from calibration_records import FAULTS
from calibration_tables import COLOURED, CONFIDENCE, WHITE, parameter_words
from lumbar.publishing.figures.palette import SERIES
from lumbar.publishing.figures.style import DOUBLE_COLUMN, house_style, label_panels, new_figure
from lumbar.tissue.diagnosis.selection.thresholds import LEVEL

SMALLEST = 2e-3
"""Probability at which the axes of the p-values begin."""
HEADROOM = 8.0
"""End of the axis of the shares: above 1 stands the legend."""
WANTED = (93.0, 97.0)
"""Per cent of the intervals."""
UNDER_FAULTS = "nulls with sensor faults"
LOOKS = {
    "nulls with sound sensors": {"color": SERIES[0], "linestyle": "-"},
    UNDER_FAULTS: {"color": SERIES[3], "linestyle": (0, (4, 1.5))},
}


@house_style
def calibration_figure(nulls: pd.DataFrame, covered: pd.DataFrame):
    """Draw reliability of p-values beside coverage of intervals.

    Parameters
    ----------
    nulls : pandas.DataFrame
        As in ``calibration_nulls.csv``.
    covered : pandas.DataFrame
        Of `calibration_tables.coverage`.
    """
    parameters = covered[["owner", "parameter"]].drop_duplicates()
    height = 1.0 + 0.19 * len(parameters)
    figure, (left, right) = new_figure(DOUBLE_COLUMN, height, ncols=2, width_ratios=(1, 0.95))
    _draw_reliability(left, nulls)
    _draw_coverage(right, covered, parameters)
    label_panels((left, right))
    return figure


def _draw_reliability(axis, nulls: pd.DataFrame) -> None:
    # Hum is an effect of the catalogue: what is left of its candidates is far from the best of all.
    nulls = nulls[nulls["condition"] != "hum"]
    faulty = nulls["condition"].isin(FAULTS)
    level = np.geomspace(SMALLEST, 1.0, 300)
    groups = dict(zip(LOOKS, (nulls[~faulty]["p_value"], nulls[faulty]["p_value"]), strict=True))
    fewest = min(map(len, groups.values()))
    tail = (1 - CONFIDENCE) / 2
    band = [binom.ppf(share, fewest, level) / fewest for share in (tail, 1 - tail)]
    axis.fill_between(
        level, *band, step="mid", color="#dddddd", linewidth=0, label=f"95 % of {fewest} fair draws"
    )
    axis.plot(level, level, color="#777777", linewidth=0.8)
    for words, values in groups.items():
        share = np.searchsorted(np.sort(values), level, side="right") / len(values)
        # A share of 0 has no logarithm: it is drawn at the foot.
        axis.step(
            level, np.maximum(share, SMALLEST), where="post", label=f"{len(values)} {words}", **LOOKS[words]
        )
    axis.axvline(LEVEL, color="#000000", linewidth=0.8, linestyle=":", label="level of selection")
    axis.set(xscale="log", yscale="log", xlim=(SMALLEST, 1), ylim=(SMALLEST, HEADROOM))
    axis.set_xlabel("p-value x of the best candidate")
    axis.set_ylabel("Share of nulls with p ≤ x")
    axis.legend(loc="upper left")


def _draw_coverage(axis, covered: pd.DataFrame, parameters: pd.DataFrame) -> None:
    axis.axvspan(*WANTED, color="#dddddd", linewidth=0)
    axis.axvline(95, color="#777777", linewidth=0.8)
    rows = {tuple(pair): row for row, pair in enumerate(parameters.itertuples(index=False))}
    looks = {
        WHITE: {"color": SERIES[0], "marker": "o", "markerfacecolor": SERIES[0]},
        COLOURED: {"color": SERIES[3], "marker": "s", "markerfacecolor": "white"},
    }
    for shift, (noise, look) in zip((-0.18, 0.18), looks.items(), strict=True):
        label = f"{noise} noise"
        for item in covered[covered["noise"] == noise].itertuples():
            at = rows[item.owner, item.parameter] + shift
            interval = binomtest(item.held, item.count).proportion_ci(CONFIDENCE, method="wilson")
            axis.hlines(at, 100 * interval.low, 100 * interval.high, color=look["color"], linewidth=0.8)
            axis.plot(100 * item.held / item.count, at, markersize=3.5, linestyle="", label=label, **look)
            label = "_"
    axis.set_yticks(range(len(rows)), [parameter_words(*pair) for pair in rows], fontsize=6)
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xlim(right=101)
    axis.grid(axis="y", visible=False)
    axis.set_xlabel("95 % intervals that hold the truth (%)")
    axis.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=2,
        borderaxespad=0.2,
        columnspacing=1.0,
        handletextpad=0.1,
    )
