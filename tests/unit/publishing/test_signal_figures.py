"""The pictures of spectra and signals: units on every axis, and rules without an answer left out."""

import numpy as np
import pytest

from lumbar.publishing.figures.signal_figures import excitation_figure, psd_figure
from lumbar.tissue.signals.excitation import Signal


@pytest.fixture
def bandwidths():
    entry = {
        "power_share": {"value_Hz": 2.5, "low_Hz": 2.2, "high_Hz": 2.8},
        "level": {"value_Hz": None, "low_Hz": None, "high_Hz": None},
    }
    return {
        "analysis_band_Hz": [0.1, 6],
        "rules": {"power_share": 0.95, "level_dB": -20},
        "position": entry,
        "velocity": entry,
    }


def texts(axis):
    return [text.get_text() for text in axis.texts]


@pytest.mark.parametrize(
    ("low", "high", "shown"), [(2.2, 2.8, "(2.20–2.80)"), (2.2, None, "(2.20–…)"), (None, None, "")]
)
def test_spectra_show_each_bandwidth_with_its_interval(bandwidths, low, high, shown):
    frequency = np.linspace(0, 50, 501)
    psd = 1 / (1 + frequency**2) * np.ones((9, 1))
    bandwidths["velocity"]["power_share"].update(low_Hz=low, high_Hz=high)
    spectra = {"position": psd, "velocity": psd}
    pooled = {name: rows[0] for name, rows in spectra.items()}
    figure = psd_figure(frequency, spectra, pooled, list("abcdefghi"), bandwidths, None)
    figure.canvas.draw()
    assert [axis.get_ylabel() for axis in figure.axes] == [
        "Position PSD (mm²/Hz)",
        "Velocity PSD ((mm/s)²/Hz)",
    ]
    assert texts(figure.axes[1]) == [f"2.50 Hz {shown}".strip()]


def test_signals_show_the_share_of_the_power_in_the_band():
    time = np.arange(1000) / 100
    sine = Signal("chirp", np.sin(2 * np.pi * 2 * time) + np.sin(2 * np.pi * 8 * time), 100.0, (0.0, 10.0))
    figure = excitation_figure([sine], 5.0)
    figure.canvas.draw()
    left, right = figure.axes
    assert (left.get_ylabel(), left.get_xlabel()) == ("Position (mm)", "Time (s)")
    assert (right.get_ylabel(), right.get_xlabel()) == ("Amplitude (mm)", "Frequency (Hz)")
    assert right.get_title() == "50.0 % of the power up to 5 Hz"
