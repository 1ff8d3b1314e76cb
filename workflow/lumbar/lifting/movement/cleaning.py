"""Cleaning of marker recordings (filling of short gaps, removal of isolated frames, low-pass filter) and derivatives.

A gap is an interval in which a marker is not seen. Short gaps between seen frames are bridged by a cubic spline through the
frames next to them. Nothing is extrapolated: a gap at the start or end of a recording stays.

The filter is a Butterworth low-pass, forward and backward. Two passes of a filter of order n keep the phase but attenuate twice,
so each pass needs a higher cut-off than the pair: Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed.,
section 3.4.4.2.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lumbar.base.errors import InputError, Problems
from lumbar.records.markers import MarkerRecording
from lumbar.records.sampling import runs
from lumbar.settings.lifting import LiftingSettings

FILLED, TOO_LONG, AT_START, AT_END, ALONE, ISLAND = (
    "filled",
    "longer than allowed",
    "at the start",
    "at the end",
    "too few frames next to it",
    "seen too briefly to be filtered: left out",
)
MIN_NEIGHBOURS = 2
"""Seen frames needed on each side of a gap, for position and direction at its edges."""
PASSES = 2
EXTENSION_PERIODS = 3
"""Periods of the cut-off after which the continuation of an interval affects a second-order filter by only about 1e-7."""
OVERSHOOT_MARGIN = 1.5
"""Factor by which the extension is longer at orders other than 2, which overshoot more."""


@dataclass(frozen=True)
class Gap:
    """An interval in which one marker is not seen."""

    marker: str
    first_frame: int
    """Index of the first missing frame, from 0."""
    n_frames: int
    start_s: float
    """Time of the first missing frame, on the recording's clock."""
    length_s: float
    """Length of the gap: missing frames divided by the rate."""
    outcome: str
    """``"filled"``, or the reason why the gap was not filled, or why seen frames were left out."""
    method: str = ""
    """Method of filling; empty if the gap was not filled."""

    @property
    def filled(self) -> bool:
        """Return whether the gap was bridged."""
        return self.outcome == FILLED


@dataclass(frozen=True)
class CleanRecording:
    """A recording ready for derivatives."""

    smooth: MarkerRecording
    """Filtered recording; NaN while a gap stays open."""
    complete: MarkerRecording
    """Recording with short gaps filled, not filtered."""
    gaps: list[Gap]
    """Gaps of every marker, then the intervals left out because they are too short."""


def clean(recording: MarkerRecording, settings: LiftingSettings) -> CleanRecording:
    """Fill short gaps, leave out intervals that are too short to be filtered, and filter.

    Gaps that stay open are not errors; a whole recording that is too short for the filter is an error.

    Parameters
    ----------
    recording : MarkerRecording
        Recording as it was read.
    settings : LiftingSettings
        Longest gap to fill, cut-off and order of the filter.
    """
    complete, gaps = fill_gaps(recording, settings.gaps.maximum_s)
    cutoff, order = settings.filter.cutoff_Hz, settings.filter.order
    complete, islands = remove_islands(complete, frames_of_cutoff(cutoff, complete.rate))
    return CleanRecording(filter_markers(complete, cutoff, order), complete, [*gaps, *islands])


def fill_gaps(recording: MarkerRecording, maximum_s: float = 0.2) -> tuple[MarkerRecording, list[Gap]]:
    """Bridge short gaps by cubic splines; return the recording and every gap, by marker and time.

    Each gap is bridged separately, by the interpolating spline through the frames seen within `maximum_s` of its ends, so that a
    distant part of the recording has no influence. Seen frames are unchanged to the last bit; a gap that stays is NaN.

    Parameters
    ----------
    recording : MarkerRecording
        Recording with NaN in the gaps.
    maximum_s : float, default 0.2
        Longest gap that is bridged: missing frames divided by the rate; 0 bridges none.
    """
    time, rate = recording.time, recording.rate
    # At least the two frames on each side, even if only very short gaps are bridged.
    window = max(MIN_NEIGHBOURS, round(maximum_s * rate))
    gaps: list[Gap] = []
    positions = {}
    for marker, points in recording.positions.items():
        visible = np.isfinite(points).all(axis=1)
        positions[marker] = filled = points.copy()
        for gap in runs(~visible):
            length_s, first = (gap.stop - gap.start) / rate, max(0, gap.start - window)
            before = first + np.flatnonzero(visible[first : gap.start])
            after = gap.stop + np.flatnonzero(visible[gap.stop : gap.stop + window])
            method = ""
            if gap.start == 0:
                outcome = AT_START
            elif gap.stop == len(points):
                outcome = AT_END
            elif length_s > maximum_s:
                outcome = TOO_LONG
            elif min(len(before), len(after)) < MIN_NEIGHBOURS:
                outcome = ALONE
            else:
                from scipy.interpolate import CubicSpline

                outcome, method = FILLED, "cubic spline"
                support = np.concatenate((before, after))
                filled[gap] = CubicSpline(time[support], points[support])(time[gap])
            start_s, frames = float(time[gap.start]), gap.stop - gap.start
            gaps.append(Gap(marker, gap.start, frames, start_s, length_s, outcome, method))
    return recording.replace_positions(positions), gaps


def remove_islands(recording: MarkerRecording, shortest: int) -> tuple[MarkerRecording, list[Gap]]:
    """Leave out intervals between gaps that are too short for the filter; return the recording and these intervals.

    Parameters
    ----------
    recording : MarkerRecording
        Recording with NaN in the gaps.
    shortest : int
        Largest length in frames of an interval that is left out.

    Raises
    ------
    InputError
        If the whole recording has no more frames than that.
    """
    if len(recording) <= shortest:
        raise InputError(
            f"{recording.source or recording.name}: {len(recording)} frames; the filter needs more than {shortest}"
        )
    positions, islands = {}, []
    for marker, points in recording.positions.items():
        short = [run for run in runs(np.isfinite(points).all(axis=1)) if run.stop - run.start <= shortest]
        positions[marker] = points.copy() if short else points
        for run in short:
            positions[marker][run] = np.nan
            frames, start_s = run.stop - run.start, float(recording.time[run.start])
            islands.append(Gap(marker, run.start, frames, start_s, frames / recording.rate, ISLAND))
    return recording.replace_positions(positions), islands


def dual_pass_sections(cutoff_Hz: float, rate: float, order: int = 2) -> np.ndarray:
    """Return the second-order sections of the filter of one pass, shape (n_sections, 6).

    The cut-off of each pass is raised so that both together attenuate by 3 dB at `cutoff_Hz`. Winter's
    correction ``(2**(1/passes) - 1)**(1/(2*order))``, 0.802 for a second-order filter, divides the pre-warped
    frequency ``tan(pi*cutoff/rate)``; so the −3 dB point is exact at any frame rate.

    Parameters
    ----------
    cutoff_Hz, rate : float
        −3 dB frequency of both passes together, between 0 and half the rate; frames per second.
    order : int, default 2
        Order of one pass.

    Raises
    ------
    InputError
        If the cut-off is not between 0 and half the rate.
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


def frames_of_cutoff(cutoff_Hz: float, rate: float) -> int:
    """Return the number of frames in one period of the cut-off: an interval must be longer to be filtered."""
    return int(np.ceil(rate / cutoff_Hz))


def extension_frames(cutoff_Hz: float, rate: float, order: int = 2) -> int:
    """Return the number of frames by which an interval is extended, so that no order leaves a larger transient than order 2.

    The slowest poles of a Butterworth filter decay with ``sin(pi/(2*order))`` times its cut-off, which
    `dual_pass_sections` raises: at order 8 about four times more slowly than at order 2.

    Parameters
    ----------
    cutoff_Hz, rate : float
        −3 dB frequency of both passes together; frames per second.
    order : int, default 2
        Order of one pass.
    """
    shortest = frames_of_cutoff(cutoff_Hz, rate)
    if order == 2:
        return EXTENSION_PERIODS * shortest
    # Decay of one pass, relative to the angular cut-off of both passes.
    decay = [np.sin(np.pi / (2 * n)) / (2 ** (1 / PASSES) - 1) ** (1 / (2 * n)) for n in (2, order)]
    return int(np.ceil(EXTENSION_PERIODS * OVERSHOOT_MARGIN * max(1.0, decay[0] / decay[1]) * shortest))


def low_pass(values: np.ndarray, rate: float, cutoff_Hz: float = 6.0, order: int = 2) -> np.ndarray:
    """Filter forward and backward, each contiguous interval of finite values separately; a missing value is NaN.

    At both ends an interval is continued by its point reflection (odd extension) over three periods of the cut-off (more at
    orders other than 2: `extension_frames`), at most over its whole length, which keeps position and velocity there. Within one
    period of an end or of a gap the result depends on this assumption.

    Parameters
    ----------
    values : numpy.ndarray, shape (n_frames,) or (n_frames, k)
        Values in any unit, NaN if missing; a row with a NaN counts as missing.
    rate : float
        Frames per second.
    cutoff_Hz : float, default 6.0
        −3 dB frequency of both passes together.
    order : int, default 2
        Order of one pass.

    Raises
    ------
    InputError
        If an interval is no longer than one period of the cut-off.
    """
    from scipy.signal import sosfiltfilt

    sections = dual_pass_sections(cutoff_Hz, rate, order)
    values = np.asarray(values, dtype=float)
    result = np.full_like(values, np.nan)
    for part in _finite_runs(
        values, frames_of_cutoff(cutoff_Hz, rate), f"a {cutoff_Hz:g} Hz filter at {rate:g} Hz"
    ):
        padding = min(extension_frames(cutoff_Hz, rate, order), part.stop - part.start - 1)
        result[part] = sosfiltfilt(sections, values[part], axis=0, padtype="odd", padlen=padding)
    return result


def filter_markers(recording: MarkerRecording, cutoff_Hz: float = 6.0, order: int = 2) -> MarkerRecording:
    """Filter every marker of a recording with `low_pass`.

    Parameters
    ----------
    recording : MarkerRecording
        Recording with NaN in the gaps.
    cutoff_Hz : float, default 6.0
        −3 dB frequency of both passes together.
    order : int, default 2
        Order of one pass.

    Raises
    ------
    InputError
        If an interval of a marker is too short; the message names every such marker.
    """
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
    return recording.replace_positions(positions)


def derivative(values: np.ndarray, rate: float, order: Literal[1, 2] = 1) -> np.ndarray:
    """Differentiate filtered values by central differences, each contiguous interval separately; a missing value is NaN.

    Three-point formulas of second-order accuracy; one-sided ones at the ends. The result for a sine of frequency f is too small
    by the factor ``sin(x)/x`` (first) or ``(sin(x/2)/(x/2))**2`` (second derivative), x = 2πf/rate: 2.4 % and 1.2 % at 6 Hz and
    100 frames per second.

    Parameters
    ----------
    values : numpy.ndarray, shape (n_frames,) or (n_frames, k)
        Filtered values in any unit, NaN if missing.
    rate : float
        Frames per second.
    order : {1, 2}, default 1
        First or second derivative.

    Raises
    ------
    InputError
        If an interval has fewer than 3 frames, or fewer than 4 for the second derivative.
    """
    if order not in (1, 2):
        raise ValueError(f"derivative of order {order}; 1 and 2 are offered")
    values = np.asarray(values, dtype=float)
    result = np.full_like(values, np.nan)
    for part in _finite_runs(values, 1 + order, f"a derivative of order {order}"):
        piece = values[part]
        if order == 1:
            result[part] = np.gradient(piece, 1 / rate, axis=0, edge_order=2)
            continue
        # Second differences; at the ends the four-point one-sided formula of the same order of accuracy.
        second = np.empty_like(piece)
        second[1:-1] = piece[2:] - 2 * piece[1:-1] + piece[:-2]
        second[0] = 2 * piece[0] - 5 * piece[1] + 4 * piece[2] - piece[3]
        second[-1] = 2 * piece[-1] - 5 * piece[-2] + 4 * piece[-3] - piece[-4]
        result[part] = second * rate**2
    return result


def _finite_runs(values: np.ndarray, too_few: int, purpose: str) -> list[slice]:
    """Return the intervals without a NaN; raise `InputError` if an interval has at most `too_few` frames."""
    finite = np.isfinite(values)
    intervals = list(runs(finite if finite.ndim == 1 else finite.all(axis=tuple(range(1, finite.ndim)))))
    for part in intervals:
        if part.stop - part.start <= too_few:
            raise InputError(
                f"frames {part.start + 1} to {part.stop}: {part.stop - part.start} frames without a gap; {purpose} needs more "
                f"than {too_few}"
            )
    return intervals
