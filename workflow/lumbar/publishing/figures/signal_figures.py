"""Figures of the spectra of the surgeons' motion with their bandwidths, and of the excitation signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from lumbar.publishing.figures.style import (
    DOUBLE_COLUMN,
    MEASURED,
    SERIES,
    house_style,
    label_panels,
    new_figure,
    note,
)

if TYPE_CHECKING:
    from lumbar.tissue.signals.excitation import Signal
    from lumbar.tissue.signals.surgeon_motion import MotionSpectra

_LABELS = {"position": "Position PSD (mm²/Hz)", "velocity": "Velocity PSD ((mm/s)²/Hz)"}
_SURGEON_STYLES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)))
_DECADES_SHOWN = 8
_WHITE = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.7}


@house_style
def psd_figure(spectra: MotionSpectra, bandwidths: dict, reference: float | None) -> Figure:
    """Draw the spectra of all trials (thin) and the pooled spectrum (thick), with the bandwidths and their intervals above.

    The first frequency of the `spectra`, 0 Hz, is not drawn: the axis is logarithmic. `bandwidths` is the result of
    `lumbar.tissue.signals.surgeon_motion.motion_bandwidths`, `reference` a published bandwidth in Hz to compare with.
    """
    frequency, surgeons, psd = spectra.frequency, spectra.surgeons, spectra.psd
    pooled = {quantity: spectra.pooled(quantity) for quantity in psd}
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
    values = {**by_rule, "unlimited": {"value_Hz": by_rule["power_share"]["without_limit_Hz"]}}
    transform = axis.get_xaxis_transform()
    for rule, (text, marker, colour, height) in named.items():
        value, low, high = (values[rule].get(key) for key in ("value_Hz", "low_Hz", "high_Hz"))
        style = {"color": colour, "transform": transform, "zorder": 4}
        # An empty line names a rule without a value in the legend.
        shown = [] if value is None else [value]
        axis.plot(shown, [height] * len(shown), marker, markersize=4.5, label=text, **style)
        if value is None:
            continue
        label, end, limit = f"{value:.2f} Hz", value, axis.get_xlim()[1]
        if low is not None:
            end = limit if high is None else high
            axis.plot([low, end], [height, height], linewidth=1.2, **style)
            label += f" ({low:.2f}–{'…' if high is None else f'{high:.2f}'})"
        # Near the right edge the label is to the left of the interval.
        is_left = end > limit / 4
        place = (low if is_left and low is not None else end, height)
        look = {"ha": "right" if is_left else "left", "va": "center", "fontsize": 6.5, "zorder": 5}
        note(axis, label, place, (-5 if is_left else 5, 0), xycoords=transform, bbox=_WHITE, **look)


_SPECTRUM_BANDS = 2.0
"""Upper end of the drawn spectra, as a multiple of the excited band."""


@house_style
def excitation_figure(signals: Sequence[Signal], band: float, note: str) -> Figure:
    """Draw position against time (left) and line amplitudes against frequency (right), one row per signal.

    `signals` are for the testing machine, `band` is the upper end of the excited band in Hz, `note` is the text below.
    """
    size = {"nrows": len(signals), "ncols": 2, "squeeze": False}
    figure, axes = new_figure(DOUBLE_COLUMN, 1.5 * len(signals) + 0.5, sharey="col", **size)
    label_panels(axes.ravel())
    for index, (signal, (left, right)) in enumerate(zip(signals, axes, strict=True)):
        start, stop = signal.window
        inside = (signal.time >= start - 1e-9) & (signal.time < stop - 1e-9)
        left.plot(signal.time[inside], signal.position[inside], color=SERIES[index], linewidth=0.8)
        left.set(xlim=(start, stop), ylabel="Position (mm)", title=signal.name)
        frequency, amplitude = signal.line_amplitudes()
        shown = frequency <= _SPECTRUM_BANDS * band + 1e-9
        right.vlines(frequency[shown], 0, amplitude[shown], color=SERIES[index], linewidth=0.9)
        right.plot(frequency[shown], amplitude[shown], ".", color=SERIES[index], markersize=2.5)
        right.axvline(band, color="#555555", linestyle=(0, (4, 2)), linewidth=0.8)
        right.set(xlim=(0, _SPECTRUM_BANDS * band), ylabel="Amplitude (mm)")
        spacing = 1 / (stop - start)
        right.set_title(f"{100 * signal.band_power_share(band):.1f} % of the power up to {band:g} Hz")
        text, look = (
            f"lines {spacing:.3g} Hz apart",
            {"xycoords": "axes fraction", "ha": "right", "fontsize": 6},
        )
        right.annotate(text, (0.98, 0.85), **look)
    for axis in axes[:, 1]:
        axis.set_ylim(0, None)
    axes[-1, 0].set_xlabel("Time (s)")
    axes[-1, 1].set_xlabel("Frequency (Hz)")
    limit = 1.08 * max(np.abs(signal.steady).max() for signal in signals)
    axes[0, 0].set_ylim(-limit, limit)
    figure.supxlabel(note)
    return figure
