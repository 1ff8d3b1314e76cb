"""Pictures of the benchmark of the diagnosis: confusion matrix and power curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binomtest

from lumbar.publishing.figures.palette import SERIES
from lumbar.publishing.figures.style import DOUBLE_COLUMN, SINGLE_COLUMN, house_style, new_figure

if TYPE_CHECKING:
    import pandas as pd

    from hidden_effects.power_curve import PowerCurve


@house_style
def confusion_figure(confusion: pd.DataFrame):
    """Draw what was said of what was hidden.

    Parameters
    ----------
    confusion : pandas.DataFrame
        Of `hidden_effects.scores.confusion`: counts, first column ``hidden``.
    """
    hidden = [str(name).replace("_", " ") for name in confusion["hidden"]]
    counts = confusion.drop(columns="hidden")
    said = [name.replace("_", " ") for name in counts.columns]
    values = counts.to_numpy()
    shares = values / np.maximum(values.sum(axis=1, keepdims=True), 1)
    figure, axis = new_figure(DOUBLE_COLUMN, 0.9 + 0.27 * len(hidden) + 1.2)
    # Blues are light where few and dark where many: readable in grey.
    image = axis.imshow(100 * shares, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for row, column in zip(*np.nonzero(values), strict=True):
        colour = "white" if shares[row, column] > 0.55 else "black"
        axis.text(column, row, values[row, column], ha="center", va="center", fontsize=6, color=colour)
    axis.set_xticks(range(len(said)), said, rotation=50, ha="right", rotation_mode="anchor")
    totals = values.sum(axis=1)
    axis.set_yticks(
        range(len(hidden)), [f"{name} ({total})" for name, total in zip(hidden, totals, strict=True)]
    )
    axis.set_xlabel("Diagnosis (first effect named, or verdict)")
    axis.set_ylabel("Hidden effect (experiments)")
    axis.grid(False)
    axis.set_xticks(np.arange(len(said) + 1) - 0.5, minor=True)
    axis.set_yticks(np.arange(len(hidden) + 1) - 0.5, minor=True)
    axis.grid(which="minor", color="#dddddd", linewidth=0.5)
    axis.tick_params(which="minor", length=0)
    figure.colorbar(image, ax=axis, label="Share of the row (%)", fraction=0.03, pad=0.01)
    return figure


_BINS = 8
"""Groups of equally many experiments in the power curve."""


@house_style
def power_figure(curve: PowerCurve, share: float, confidence: float):
    """Draw the share of effects named over their strength.

    Parameters
    ----------
    share : float
        Share marked by a line.
    confidence : float
        Of the Wilson intervals of the binned shares.
    """
    figure, axis = new_figure(1.4 * SINGLE_COLUMN, 3.2)
    fine = np.geomspace(curve.strength[0], curve.strength[-1], 200)
    for group in np.array_split(np.arange(len(curve.strength)), min(_BINS, len(curve.strength))):
        named = int(curve.named[group].sum())
        interval = binomtest(named, len(group)).proportion_ci(confidence, method="wilson")
        centre = np.exp(np.mean(np.log(curve.strength[group])))
        axis.vlines(centre, 100 * interval.low, 100 * interval.high, color=SERIES[6], linewidth=0.8)
        axis.plot(centre, 100 * named / len(group), "o", color=SERIES[6], markersize=4)
    axis.plot(fine, 100 * curve.share(fine), color=SERIES[0], label="Logistic")
    axis.step(
        curve.strength, 100 * curve.isotonic, where="post", color=SERIES[1], linestyle="--", label="Isotonic"
    )
    axis.plot(
        [],
        [],
        "o-",
        color=SERIES[6],
        markersize=4,
        linewidth=0.8,
        label=f"Share, Wilson {100 * confidence:g} %",
    )
    axis.axhline(100 * share, color="#777777", linewidth=0.7, linestyle=":")
    reached = curve.strength_at(share)
    if reached is not None and reached > curve.strength[0]:
        axis.axvline(reached, color="#777777", linewidth=0.7, linestyle=":")
        axis.annotate(
            f"{100 * share:g} % at {reached:.2g} × noise",
            (reached, 4),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=7,
        )
    axis.set_xscale("log")
    ticks = [
        tick
        for tick in (1, 1.5, 2, 3, 4, 6, 8, 12, 16, 26)
        if curve.strength[0] <= tick <= curve.strength[-1]
    ]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_ylim(-3, 103)
    axis.set_xlabel("Residual of the best KB model over noise (RMS ratio)")
    axis.set_ylabel("Effects named (%)")
    axis.legend(loc="lower right")
    return figure
