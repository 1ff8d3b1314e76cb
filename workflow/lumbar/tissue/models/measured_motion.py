"""Measured motion, filtered before it is differentiated.

A simulation of a forward record estimates its start from this channel. Angles of a pendulum come from noisy markers or are
rounded in a file. The second derivative multiplies noise by the square of its frequency: at 100 Hz a millirad of noise gives 48
rad/s². The angle is therefore replaced by a quintic least-squares spline with knots chosen by cross-validation.
"""

from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Channel, Record
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.motion import JoinedMotions, Motion

MEASURED = "measured_motion"
"""Role of the channel with the measured motion, from which a simulation estimates its start."""
_BLOCKS = 8  # of a record, with averaged spectra
_MIN_POWER_RATIO = 4.0  # of the motion to the noise, at a frequency with visible motion
_NOISE_SHARE = 0.25  # of the frequencies, the highest ones, that show the noise
_CUTOFF_RATIO = 1.5  # of the cut-off to the highest frequency with visible motion
_ORDER = 4
_MAX_CUTOFF = 0.45  # cycles per sample; above it nothing is smoothed


def add_measured_motion(record: Record) -> Record:
    """Return the record with its filtered output as an additional channel, from which a simulation estimates its start.

    At rest before the load the filtered output is constant.

    Parameters
    ----------
    record : Record
        Record with a force as input and a motion as output.
    """
    output = record.channels["output"]
    filtered = remove_noise(output.values)
    count = resting_samples(record["input"], output.values)
    if count:
        filtered = np.append(np.full(count, output.values[:count].mean()), filtered[count:])
    channel = Channel(filtered, output.quantity, output.unit)
    return replace(record, channels={**record.channels, MEASURED: channel})


def remove_noise(signal: np.ndarray) -> np.ndarray:
    """Filter out the frequencies at which a signal shows only noise, by a zero-phase Butterworth filter.

    The noise level is the power in the highest quarter of the frequencies, in which a motion has little power.

    Parameters
    ----------
    signal : numpy.ndarray, shape (samples,)
        Evenly sampled signal in any unit; the result has the same shape and unit.
    """
    frequency, power = scipy.signal.welch(signal, nperseg=min(len(signal), max(len(signal) // _BLOCKS, 64)))
    noise = float(np.median(power[frequency > 0.5 * (1 - _NOISE_SHARE)]))
    visible = np.flatnonzero(power > _MIN_POWER_RATIO * noise)
    cut = _CUTOFF_RATIO * float(frequency[visible[-1]]) if len(visible) else 0.0
    if not 0 < cut < _MAX_CUTOFF:
        return signal
    return scipy.signal.sosfiltfilt(scipy.signal.butter(_ORDER, 2 * cut, output="sos"), signal)


_KNOT_SPACINGS = 2.0 * 1.4 ** np.arange(18)  # samples; the first one leaves the angle unchanged
_MIN_KNOTS = 12
_MAX_ERROR_RATIO = 2.0  # to the least error; above it the knots are too far apart to follow the movement


def for_base(record: Record, base: Base) -> Record:
    """Return the record for a base: with a smooth angle for a pendulum, unchanged for other bases.

    Parameters
    ----------
    record : Record
        Measured record; a pendulum's input is an angle in radians.
    base : Base
        Base whose system decides.

    Raises
    ------
    InputError
        If a pendulum's angle exceeds a full turn: no joint turns so far, so the angles are probably in degrees.
    """
    if base.system != "pendulum":
        return record
    largest = float(np.abs(record["input"]).max())
    if largest > 2 * np.pi:
        raise InputError(
            f"{record.source or record.name}: the angle reaches {largest:.3g} rad, more than a full turn; if it is in "
            "degrees, give its column scale: 0.0174533 in lifting.moment_layout"
        )
    return smooth_angle(record)


def smooth_angle(record: Record) -> Record:
    """Return the record with its input smoothed by a spline, or unchanged if no spline improves it.

    The distance of the knots minimises the generalised cross-validation error (Craven and Wahba, Numer. Math. 31 (1979)
    377-403).

    Parameters
    ----------
    record : Record
        Record with an evenly sampled input.
    """
    angle = record["input"]
    samples = np.arange(len(angle), dtype=float)
    best, least = None, np.inf
    for spacing in _KNOT_SPACINGS[len(angle) / _MIN_KNOTS > _KNOT_SPACINGS]:
        # Quintic spline with even knots, and its generalised cross-validation error.
        inner = np.linspace(0, samples[-1], max(int(len(angle) / spacing), 1) + 1)
        knots = np.concatenate([np.full(5, inner[0]), inner, np.full(5, inner[-1])])
        values = scipy.interpolate.make_lsq_spline(samples, angle, knots, k=5)(samples)
        error = np.mean((values - angle) ** 2) / (1 - (len(knots) - 6) / len(angle)) ** 2
        if error < least:
            best, least = (None if spacing == _KNOT_SPACINGS[0] else values), error
        elif error > _MAX_ERROR_RATIO * least:
            break
    return record if best is None else record.with_values(input=best)


_MIN_JUMP = 0.1  # median jump of a held input, relative to its range


def is_held(motion: Motion | JoinedMotions) -> bool:
    """Return whether an input is constant between jumps, like a command with few levels; it then has no derivatives.

    Parameters
    ----------
    motion : Motion or JoinedMotions
        Motion with the input as position.
    """
    position = motion.position
    steps = np.abs(np.diff(position))
    moved = steps[steps > 0]
    return moved.size < len(steps) / 2 and bool(np.median(moved) > _MIN_JUMP * np.ptp(position))


_MIN_REST_SAMPLES = 5
_REST_SIGMAS, _REST_SHARE = 5.0, 1e-3
"""Largest change at rest: in standard deviations of the noise, and as a share of the range, which add up."""


def noise_of(signal: np.ndarray) -> float:
    """Return the standard deviation of white noise on a slow signal, from its second differences.

    Parameters
    ----------
    signal : numpy.ndarray, shape (samples,)
        Evenly sampled signal in any unit.
    """
    return float(1.4826 * np.median(np.abs(np.diff(signal, 2))) / np.sqrt(6))


def resting_samples(force: np.ndarray, position: np.ndarray) -> int:
    """Return the number of samples at the start of a record without load and motion; 0 if it does not begin so.

    Parameters
    ----------
    force, position : numpy.ndarray, shape (samples,)
        Force, and position from any zero.
    """
    limits = [_REST_SIGMAS * noise_of(item) + _REST_SHARE * float(np.ptp(item)) for item in (force, position)]
    loaded = np.abs(force) > limits[0]
    count = int(np.argmax(loaded))
    # The load may begin between the last sample at rest and the next one.
    rest = position[: max(count - 1, 0)]
    if not loaded.any() or len(rest) < _MIN_REST_SAMPLES:
        return 0
    return len(rest) if np.abs(rest - np.median(rest)).max() <= limits[1] else 0
