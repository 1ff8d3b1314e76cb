"""Cleaning a marker recording: gaps filled, what is seen too briefly left out, low-pass filtered; and derivatives.

The filter is a Butterworth low-pass, forward and backward.
Two passes of a filter of order n leave the phase alone but attenuate twice, so each pass has a higher cut-off
than the two together: Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed., section 3.4.4.2.
"""

from dataclasses import replace

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.lifting.movement.gaps import Gap, fill_gaps, without_islands
from lumbar.records.markers import MarkerRecording
from lumbar.records.stretches import runs
from lumbar.settings.lifting import LiftingSettings

PASSES = 2
EXTENSION_PERIODS = 3
"""Periods of the cut-off after which a second-order filter has forgotten how a stretch was continued, to about 1e-7."""
_OVERSHOOT_MARGIN = 1.5
"""Factor on the extension for the larger overshoot of other orders."""


def clean(
    recording: MarkerRecording, settings: LiftingSettings
) -> tuple[MarkerRecording, MarkerRecording, list[Gap]]:
    """Fill short gaps, leave out what is seen too briefly to be filtered, and filter.

    Gaps that stay are no error here: whoever needs a marker says what a gap in it means. A recording that is too short for
    the filter altogether is one. Returned are the recording ready for derivatives, NaN where a gap stays open; the same without
    the filter; and the gaps of every marker, with those frames last that were seen too briefly.
    """
    complete, gaps = fill_gaps(recording, settings.gaps.maximum_s)
    cutoff, order = settings.filter.cutoff_Hz, settings.filter.order
    complete, islands = without_islands(complete, shortest_stretch(cutoff, complete.rate))
    return filter_markers(complete, cutoff, order), complete, [*gaps, *islands]


def dual_pass_sections(cutoff_Hz: float, rate: float, order: int = 2) -> np.ndarray:
    """Second-order sections of the filter of one pass, of the given order, shape (n_sections, 6).

    The cut-off of each pass is raised so that both together attenuate by 3 dB at `cutoff_Hz`. Winter's
    correction ``(2**(1/passes) - 1)**(1/(2*order))``, 0.802 for a second-order filter, divides the pre-warped
    frequency ``tan(pi*cutoff/rate)``; so the −3 dB point is exact at any frame rate.

    `cutoff_Hz` is the −3 dB frequency of both passes together, between 0 and half the rate.
    """
    from scipy.signal import butter

    if not 0 < cutoff_Hz < rate / 2:
        raise InputError(
            f"filter.cutoff_Hz is {cutoff_Hz:g}; it must lie between 0 and half the rate, {rate / 2:g} Hz"
        )
    correction = (2 ** (1 / PASSES) - 1) ** (1 / (2 * order))
    warped = np.tan(np.pi * cutoff_Hz / rate) / correction
    # As a share of half the rate, which is how scipy states digital frequencies.
    return butter(order, 2 / np.pi * np.arctan(warped), output="sos")


def shortest_stretch(cutoff_Hz: float, rate: float) -> int:
    """Frames of one period of the cut-off: a stretch must be longer to be filtered."""
    return int(np.ceil(rate / cutoff_Hz))


def extension_frames(cutoff_Hz: float, rate: float, order: int = 2) -> int:
    """Frames by which a stretch is extended, so that no order leaves a larger transient than order 2.

    The slowest poles of a Butterworth filter decay with ``sin(pi/(2*order))`` times its cut-off, which
    `dual_pass_sections` raises: at order 8 about four times more slowly than at order 2.
    """
    shortest = shortest_stretch(cutoff_Hz, rate)
    if order == 2:
        return EXTENSION_PERIODS * shortest
    slower = max(1.0, _slowest_decay(2) / _slowest_decay(order))
    return int(np.ceil(EXTENSION_PERIODS * _OVERSHOOT_MARGIN * slower * shortest))


def _slowest_decay(order: int) -> float:
    """Decay rate of the slowest poles of one pass, relative to the angular cut-off of both passes."""
    return np.sin(np.pi / (2 * order)) / (2 ** (1 / PASSES) - 1) ** (1 / (2 * order))


def low_pass(values: np.ndarray, rate: float, cutoff_Hz: float = 6.0, order: int = 2) -> np.ndarray:
    """Filter forward and backward, each contiguous stretch of finite values on its own.

    At both ends a stretch is continued by its own point reflection (odd extension) over three periods of the
    cut-off (more at orders other than 2: `extension_frames`), or as far as it reaches, which keeps position and
    velocity there. Within one period of an end or of a gap the result leans on this assumption.

    `values` have shape (n_frames,) or (n_frames, k), with NaN where missing, as in the result; a row with a NaN counts
    as missing altogether. `cutoff_Hz` and `order` are as of `dual_pass_sections`.

    Raises
    ------
    InputError
        When a stretch is no longer than one period of the cut-off.
    """
    from scipy.signal import sosfiltfilt

    sections = dual_pass_sections(cutoff_Hz, rate, order)
    values = np.asarray(values, dtype=float)
    shortest = shortest_stretch(cutoff_Hz, rate)
    result = np.full_like(values, np.nan)
    for stretch in _finite_runs(values):
        length = stretch.stop - stretch.start
        if length <= shortest:
            raise InputError(
                f"frames {stretch.start + 1} to {stretch.stop}: {length} frames without a gap; a "
                f"{cutoff_Hz:g} Hz filter at {rate:g} Hz needs more than {shortest}"
            )
        padding = min(extension_frames(cutoff_Hz, rate, order), length - 1)
        result[stretch] = sosfiltfilt(sections, values[stretch], axis=0, padtype="odd", padlen=padding)
    return result


def filter_markers(recording: MarkerRecording, cutoff_Hz: float = 6.0, order: int = 2) -> MarkerRecording:
    """Filter every marker of a recording with `low_pass`; an error names every marker with a stretch that is too short."""
    # A cut-off that does not fit the rate is one problem, not one per marker.
    dual_pass_sections(cutoff_Hz, recording.rate, order)
    problems = Problems(recording.source or recording.name)
    positions = {}
    for marker, points in recording.positions.items():
        try:
            positions[marker] = low_pass(points, recording.rate, cutoff_Hz, order)
        except InputError as error:
            problems.add(marker, str(error))
    problems.raise_if_any()
    return replace(recording, positions=positions)


def derivative(values: np.ndarray, rate: float, order: int = 1) -> np.ndarray:
    """Differentiate filtered values by central differences, each contiguous stretch on its own.

    Three-point formulas of second-order accuracy; one-sided ones at the ends. A sine of frequency f comes out
    too small by the factor ``sin(x)/x`` (first) or ``(sin(x/2)/(x/2))**2`` (second derivative), x = 2πf/rate:
    2.4 % and 1.2 % at 6 Hz and 100 frames per second.

    Values have the shape (n_frames,) or (n_frames, k), NaN where missing, as has the result, in their unit per second (per
    second squared). A stretch must have the 3 frames that the formulas need, 4 for the second derivative.
    """
    if order not in (1, 2):
        raise ValueError(f"derivative of order {order}; 1 and 2 are offered")
    values = np.asarray(values, dtype=float)
    result = np.full_like(values, np.nan)
    for stretch in _finite_runs(values):
        part = values[stretch]
        if len(part) < 2 + order:
            raise InputError(
                f"frames {stretch.start + 1} to {stretch.stop}: {len(part)} frames without a gap; "
                f"a derivative of order {order} needs {2 + order}"
            )
        result[stretch] = (
            np.gradient(part, 1 / rate, axis=0, edge_order=2) if order == 1 else _second(part, rate)
        )
    return result


def _second(values: np.ndarray, rate: float) -> np.ndarray:
    """Second differences; the ends by the four-point one-sided formula of the same order of accuracy."""
    result = np.empty_like(values)
    result[1:-1] = values[2:] - 2 * values[1:-1] + values[:-2]
    result[0] = 2 * values[0] - 5 * values[1] + 4 * values[2] - values[3]
    result[-1] = 2 * values[-1] - 5 * values[-2] + 4 * values[-3] - values[-4]
    return result * rate**2


def _finite_runs(values: np.ndarray):
    finite = np.isfinite(values)
    return runs(finite if finite.ndim == 1 else finite.all(axis=tuple(range(1, finite.ndim))))
