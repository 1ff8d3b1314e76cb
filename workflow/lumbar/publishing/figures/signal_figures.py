"""Spectra of the surgeons' motion with the bandwidths read off them, and the excitation signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from lumbar.publishing.figures.palette import MEASURED, SERIES
from lumbar.publishing.figures.style import DOUBLE_COLUMN, house_style, label_panels, new_figure, note

if TYPE_CHECKING:
    from lumbar.tissue.signals.excitation import Signal

_LABELS = {"position": "Position PSD (mm²/Hz)", "velocity": "Velocity PSD ((mm/s)²/Hz)"}
_SURGEON_STYLES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)))
_DECADES_SHOWN = 8
_WHITE = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.7}


@house_style
def psd_figure(
    frequency: np.ndarray,
    psd: Mapping[str, np.ndarray],
    pooled: Mapping[str, np.ndarray],
    surgeons: Sequence[str],
    bandwidths: dict,
    reference: float | None,
) -> Figure:
    """Draw every trial thin, the pooled spectrum thick, and the bandwidths with their intervals above.

    Parameters
    ----------
    frequency : numpy.ndarray of float, shape (lines,)
        Hz, the first being 0 (not drawn: the axis is logarithmic).
    psd : mapping of str to numpy.ndarray of float, shape (trials, lines)
        By quantity.
    pooled : mapping of str to numpy.ndarray of float, shape (lines,)
        By quantity.
    surgeons : sequence of str
        Of every trial.
    bandwidths : dict
        As `lumbar.tissue.signals.surgeon_motion.motion_bandwidths` returns it.
    reference : float or None
        A published bandwidth in Hz to compare with.
    """
    figure, axes = new_figure(DOUBLE_COLUMN, 3.8, ncols=2, sharex=True)
    label_panels(axes)
    people = sorted(set(surgeons))
    for axis, quantity in zip(axes, pooled, strict=True):
        for surgeon, row in zip(surgeons, psd[quantity], strict=True):
            index = people.index(surgeon)
            color = SERIES[index % (len(SERIES) - 1)]
            line = _SURGEON_STYLES[index % len(_SURGEON_STYLES)]
            axis.loglog(frequency[1:], row[1:], color=color, linestyle=line, linewidth=0.5, alpha=0.6)
        mean = {"color": MEASURED, "linewidth": 1.8, "label": "mean of all surgeons"}
        axis.loglog(frequency[1:], pooled[quantity][1:], **mean)
        # Head-room above the spectra keeps the intervals clear of them.
        top = max(psd[quantity][:, 1:].max(), pooled[quantity].max())
        bottom = max(pooled[quantity][1:].min() / 5, top * 10.0**-_DECADES_SHOWN)
        axis.set(ylim=(bottom, top * 60), xlim=(frequency[1], frequency[-1]))
        limit = bandwidths["analysis_band_Hz"][1]
        axis.axvspan(limit, frequency[-1], color="#eeeeee", zorder=0, label="outside the analysis band")
        if reference is not None:
            look = {"color": "#D55E00", "linestyle": (0, (4, 2)), "label": f"thesis: {reference:g} Hz"}
            axis.axvline(reference, ymax=0.72, **look)
        _draw_bandwidths(axis, bandwidths[quantity], bandwidths["rules"])
        axis.set(xlabel="Frequency (Hz)", ylabel=_LABELS[quantity])
        axis.xaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_locator(NullLocator())
    close = {"ncols": 3, "columnspacing": 1.2, "handlelength": 1.6}
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", **close)
    return figure


def _draw_bandwidths(axis, by_rule: dict, rules: dict) -> None:
    """Draw the bandwidth of each rule with its interval above the spectra."""
    named = {
        "power_share": (f"{100 * rules['power_share']:g} % of the power", "o", "#0072B2", 0.95),
        "unlimited": ("the same without the band's limit", "D", "#56B4E9", 0.87),
        "level": (f"{-rules['level_dB']:g} dB under the peak", "s", "#009E73", 0.79),
    }
    unlimited = {"value_Hz": by_rule["power_share"]["without_limit_Hz"]}
    transform = axis.get_xaxis_transform()
    for rule, (text, marker, colour, height) in named.items():
        found = {**by_rule, "unlimited": unlimited}[rule]
        value, low, high = (found.get(key) for key in ("value_Hz", "low_Hz", "high_Hz"))
        style = {"color": colour, "transform": transform, "zorder": 4}
        # An empty line names a rule without a value in the legend.
        shown = [] if value is None else [value]
        axis.plot(shown, [height] * len(shown), marker, markersize=4.5, label=text, **style)
        if value is None:
            continue
        label, end = f"{value:.2f} Hz", value
        if low is not None:
            end = axis.get_xlim()[1] if high is None else high
            axis.plot([low, end], [height, height], linewidth=1.2, **style)
            label += f" ({low:.2f}–{'…' if high is None else f'{high:.2f}'})"
        beyond = end > axis.get_xlim()[1] / 4
        at, side = (low if beyond and low is not None else end, height), "right" if beyond else "left"
        look = {"ha": side, "va": "center", "fontsize": 6.5, "zorder": 5, "bbox": _WHITE}
        note(axis, label, at, (-5 if beyond else 5, 0), xycoords=transform, **look)


_SHOWN_TO = 2.0
"""Upper end of the drawn spectra, as a multiple of the excited band."""


@house_style
def excitation_figure(signals: Sequence[Signal], band: float, note: str) -> Figure:
    """Draw position against time (left) and line amplitudes against frequency (right), one row per signal.

    `band` is the upper end of the excited band, Hz; `note` is written below the figure.
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 1.5 * len(signals) + 0.5, nrows=len(signals), ncols=2, squeeze=False, sharey="col"
    )
    label_panels(axes.ravel())
    for index, (signal, (left, right)) in enumerate(zip(signals, axes, strict=True)):
        start, stop = signal.window
        inside = (signal.time >= start - 1e-9) & (signal.time < stop - 1e-9)
        left.plot(signal.time[inside], signal.position[inside], color=SERIES[index], linewidth=0.8)
        left.set(xlim=(start, stop), ylabel="Position (mm)", title=signal.name)
        frequency, amplitude = signal.line_amplitudes()
        shown = frequency <= _SHOWN_TO * band + 1e-9
        right.vlines(frequency[shown], 0, amplitude[shown], color=SERIES[index], linewidth=0.9)
        right.plot(frequency[shown], amplitude[shown], ".", color=SERIES[index], markersize=2.5)
        right.axvline(band, color="#555555", linestyle=(0, (4, 2)), linewidth=0.8)
        right.set(xlim=(0, _SHOWN_TO * band), ylabel="Amplitude (mm)")
        spacing = 1 / (stop - start)
        right.set_title(f"{100 * signal.band_power_share(band):.1f} % of the power up to {band:g} Hz")
        right.annotate(
            f"lines {spacing:.3g} Hz apart", (0.98, 0.85), xycoords="axes fraction", ha="right", fontsize=6
        )
    for axis in axes[:, 1]:
        axis.set_ylim(0, None)
    axes[-1, 0].set_xlabel("Time (s)")
    axes[-1, 1].set_xlabel("Frequency (Hz)")
    limit = 1.08 * max(np.abs(signal.steady).max() for signal in signals)
    axes[0, 0].set_ylim(-limit, limit)
    figure.supxlabel(note)
    return figure
