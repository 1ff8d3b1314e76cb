"""The excitation signals in time and in frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lumbar.publishing.figures.style import DOUBLE_COLUMN, SERIES, house_style, label_panels, new_figure

if TYPE_CHECKING:
    from lumbar.tissue.signals.excitation import Signal

_SHOWN_TO = 2.0
"""The spectra are shown up to this factor times the excited band."""


@house_style
def excitation_figure(signals: Sequence[Signal], band: float):
    """Draw position against time (left) and line amplitudes against frequency (right), one row per signal.

    Parameters
    ----------
    signals : sequence of lumbar.tissue.signals.excitation.Signal
    band : float
        Upper end of the excited band, Hz.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(
        DOUBLE_COLUMN, 1.5 * len(signals) + 0.3, nrows=len(signals), ncols=2, squeeze=False, sharey="col"
    )
    label_panels(axes.ravel())
    for index, (signal, (left, right)) in enumerate(zip(signals, axes, strict=True)):
        start, stop = signal.window
        inside = (signal.time >= start - 1e-9) & (signal.time < stop - 1e-9)
        left.plot(signal.time[inside], signal.position[inside], color=SERIES[index], linewidth=0.8)
        left.set_xlim(start, stop)
        left.set_ylabel("Position (mm)")
        left.set_title(signal.name)
        frequency, amplitude = signal.line_amplitudes()
        shown = frequency <= _SHOWN_TO * band + 1e-9
        right.vlines(frequency[shown], 0, amplitude[shown], color=SERIES[index], linewidth=0.9)
        right.plot(frequency[shown], amplitude[shown], ".", color=SERIES[index], markersize=2.5)
        right.axvline(band, color="#555555", linestyle=(0, (4, 2)), linewidth=0.8)
        right.set_xlim(0, _SHOWN_TO * band)
        right.set_ylabel("Amplitude (mm)")
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
    return figure
