"""Measured motion, filtered before it is differentiated.

In forward records it is the channel from which a simulation estimates its start. Angles of a pendulum come from noisy markers,
or rounded from a file. The second derivative multiplies noise by the square of its frequency: rounding to five decimals at
100 Hz makes 0.14 rad/s², a millirad of noise 48 rad/s². The angle is therefore replaced by a quintic spline fitted by least
squares, with knots as far apart as cross-validation allows.
"""

from dataclasses import replace

import numpy as np
import scipy

from lumbar.base.errors import InputError
from lumbar.records.record import Record
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.motion import JoinedMotions, Motion

MEASURED = "measured_motion"
"""Role of the channel with the measured motion, from which a simulation estimates its start."""
_BLOCKS = 8  # of a record, whose spectra are averaged
_MIN_POWER_RATIO = 4.0  # of the motion to the noise, at a frequency with visible motion
_NOISE_SHARE = 0.25  # of the frequencies, the highest ones, that show the noise
_ROOM = 1.5
_ORDER = 4
_MAX_CUTOFF = 0.45  # cycles per sample; above it nothing is smoothed


def add_measured_motion(record: Record) -> Record:
    """Return the record with its filtered output as a further channel, from which a simulation estimates its start."""
    output = record.channels["output"]
    filtered = replace(output, values=remove_noise(output.values))
    return replace(record, channels={**record.channels, MEASURED: filtered})


def remove_noise(signal: np.ndarray) -> np.ndarray:
    """Return a signal without the frequencies that show only noise, by a zero-phase Butterworth filter.

    The highest quarter of the frequencies gives the level of the noise; a motion has little power there.
    """
    frequency, power = scipy.signal.welch(signal, nperseg=min(len(signal), max(len(signal) // _BLOCKS, 64)))
    noise = float(np.median(power[frequency > 0.5 * (1 - _NOISE_SHARE)]))
    seen = np.flatnonzero(power > _MIN_POWER_RATIO * noise)
    cut = _ROOM * float(frequency[seen[-1]]) if len(seen) else 0.0
    if not 0 < cut < _MAX_CUTOFF:
        return signal
    return scipy.signal.sosfiltfilt(scipy.signal.butter(_ORDER, 2 * cut, output="sos"), signal)


SPACINGS = 2.0 * 1.4 ** np.arange(18)
"""Distances of knots in samples that are tried. The first one leaves the angle unchanged."""
FEWEST_KNOTS = 12
_PAST_THE_LEAST = 2.0
"""Once the error is above its least by this factor, the knots have become too far apart to follow the movement."""


def for_base(record: Record, base: Base) -> Record:
    """Return the record as a base needs it: a pendulum's with a smooth angle, others unchanged.

    Raises
    ------
    InputError
        If a pendulum's angle goes beyond a full turn: no joint does, but degrees taken for radians do.
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

    The knots' distance is the one with the least generalised cross-validation error (Craven and Wahba, Numer. Math. 31
    (1979) 377-403).
    """
    angle = record["input"]
    samples = np.arange(len(angle), dtype=float)
    best, least = None, np.inf
    for spacing in SPACINGS[len(angle) / FEWEST_KNOTS > SPACINGS]:
        # Quintic spline with even knots, and its generalised cross-validation error.
        inner = np.linspace(0, samples[-1], max(int(len(angle) / spacing), 1) + 1)
        knots = np.concatenate([np.full(5, inner[0]), inner, np.full(5, inner[-1])])
        values = scipy.interpolate.make_lsq_spline(samples, angle, knots, k=5)(samples)
        coefficients = len(knots) - 6
        error = np.mean((values - angle) ** 2) / (1 - coefficients / len(angle)) ** 2
        if error < least:
            best, least = (None if spacing == SPACINGS[0] else values), error
        elif error > _PAST_THE_LEAST * least:
            break
    return record if best is None else record.with_values(input=best)


_MIN_JUMP = 0.1  # share of its range by which a held input typically jumps


def is_held(motion: Motion | JoinedMotions) -> bool:
    """Whether an input is held between jumps, as a command of a few levels is; such an input has no derivatives."""
    position = motion.position
    steps = np.abs(np.diff(position))
    moved = steps[steps > 0]
    return moved.size < len(steps) / 2 and bool(np.median(moved) > _MIN_JUMP * np.ptp(position))
