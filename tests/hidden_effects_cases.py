"""Diagnoses and motions of recorded files for several tests of the hidden effects."""

import numpy as np
from scipy.interpolate import make_interp_spline

from lumbar.twin.two_hidden_effects import OVERSAMPLING, ToolMotion


def recorded_motion(name: str, time: np.ndarray, position: np.ndarray) -> ToolMotion:
    """Motion between the samples of a band-limited recording, by a spline of seventh degree."""
    spline = make_interp_spline(time, position, k=7)
    step = (time[1] - time[0]) / OVERSAMPLING
    fine = step * np.arange((len(time) - 1) * OVERSAMPLING + 1)
    return ToolMotion(name, step, spline(fine), spline(fine, 1), spline(fine, 2))


def diagnosis(
    verdict: str, selected=(), tied_with=(), test_rms: float = 1.0, complete=True, after="adequate"
) -> dict:
    """A diagnosis as the benchmark reads it."""
    return {
        "verdict": verdict,
        "verdict_after": after,
        "selected": list(selected),
        "tied_with": list(tied_with),
        "complete": complete,
        "ladder": [{"effects": [], "test_rms": 9.0}, {"effects": list(selected), "test_rms": test_rms}],
    }
