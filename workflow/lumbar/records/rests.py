"""Positions that rest: at a few commanded levels (binary and multilevel signals, steps), and before a test begins."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lumbar.records.record import Record

MOST_LEVELS = 8
"""Largest number of levels of a command; a coarse sensor has more."""
_MIN_RESTING_SHARE = 0.5
"""Smallest share of samples at the levels."""
_MIN_LEVEL_SHARE = 0.01
"""Smallest share of the resting samples at one level."""
_TOLERANCE = 1e-4
"""Difference of equal positions, as a share of the range: a servo settles, and digits are rounded."""
_STEP_SIGMAS = 5.0
"""Difference of equal positions with noise, in standard deviations of the difference of two samples."""
_QUARTILE = 0.3186
"""First quartile of the absolute value of a normal variable with unit variance."""
_LEVEL_SPREADS = 7.0
"""Largest distance of a sample from its level, in medians of the distance: five standard deviations of noise."""
_MIN_GAP_RATIO = 4.0
"""Smallest distance of two levels, in largest distances of a sample from its level."""
_MAX_JUMP_SAMPLES, _MAX_MOVE_SAMPLES = 2.0, 5.0
"""Largest mean number of samples between two levels of a position that jumps: its speed is unknown; and of a binary signal: its
speed is too coarse to show friction or a curve."""
_MIN_CHANGES = 4
"""Smallest number of changes between two levels of a binary signal; fewer are those of a test with holds."""
_STILL_SHARE, _REST_SHARE = 5e-4, 0.01
"""Largest motion of a tool that is still, and that is slow, as shares of a record's range; the latter also limits the change of
the force, as a share of the force's range."""
_UNLOADED_SHARE = 0.02
"""Largest force of tissue that is not loaded yet, as a share of the force's range."""
_MIN_REST_SAMPLES = 5


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels at which a channel rests."""

    values: np.ndarray
    """Mean of the samples at each level, ascending, in the channel's unit."""
    resting: np.ndarray
    """True for each sample at a level, shape (samples,)."""
    changes: int
    """Number of changes of the level."""

    @property
    def move_samples(self) -> float:
        """Mean number of samples from level to level."""
        return float(np.sum(~self.resting)) / max(self.changes, 1)

    @property
    def jumps(self) -> bool:
        """True if the channel moves from level to level within so few samples that its speed is unknown."""
        return self.move_samples <= _MAX_JUMP_SAMPLES


def find_levels(values: np.ndarray) -> Levels | None:
    """Return the levels of a channel that rests most of its time at two to `MOST_LEVELS` levels; None for any other channel."""
    span = float(np.ptp(values))
    if span == 0 or len(values) < 2:
        return None
    steps = np.abs(np.diff(values))
    # Most steps are those of a rest: their size is that of the noise. A channel that moves on has no rest within this size.
    noise = float(np.quantile(steps, 0.25)) / _QUARTILE
    tolerance = max(_STEP_SIGMAS * noise, _TOLERANCE * span)
    resting = np.sort(values[1:][steps <= tolerance])
    groups = np.split(resting, np.flatnonzero(np.diff(resting) > tolerance) + 1)
    groups = [group for group in groups if len(group) >= max(_MIN_LEVEL_SHARE * len(resting), 2)]
    if not 2 <= len(groups) <= MOST_LEVELS:
        return None
    levels = np.array([np.median(group) for group in groups])
    spreads = [float(np.median(np.abs(group - level))) for group, level in zip(groups, levels, strict=True)]
    width = max(_LEVEL_SPREADS * max(spreads), _TOLERANCE * span)
    if np.diff(levels).min() < _MIN_GAP_RATIO * width:
        return None
    nearest = np.abs(values[:, None] - levels).argmin(axis=1)
    at_level = np.abs(values - levels[nearest]) <= width
    if np.mean(at_level) < _MIN_RESTING_SHARE:
        return None
    levels = np.array([values[at_level & (nearest == number)].mean() for number in range(len(levels))])
    return Levels(levels, at_level, int(np.count_nonzero(np.diff(nearest[at_level]))))


def find_two_levels(records: Sequence[Record]) -> Levels | None:
    """Return the levels if the positions of all records jump again and again between the same two levels, else None.

    Samples between the levels show a force of hardly known speed. All moves are alike, so that a spring, a damper, friction and
    any curve explain them equally well.
    """
    levels = find_levels(np.concatenate([record["input"] for record in records]))
    if levels is None or len(levels.values) > 2 or levels.changes < _MIN_CHANGES:
        return None
    return levels if levels.move_samples <= _MAX_MOVE_SAMPLES else None


def begins_at_rest(record: Record) -> bool:
    """Return whether a record begins with a constant position and force, or at an end of its motion without a force."""
    position, force = record["input"], record["output"]
    span, size = float(np.ptp(position)), float(np.ptp(force))
    if not span or not size:
        return False
    moved = np.abs(position - position[0])
    count, slow = (int(np.argmax(moved > share * span)) for share in (_STILL_SHARE, _REST_SHARE))
    rest = force[: max(count, 1)]
    # Standard error of the mean of half of the rest, from differences of neighbours, which a slow change hardly affects.
    error = float(np.std(np.diff(rest))) / np.sqrt(count) if count > 2 else 0.0
    # A rest ends abruptly; a smooth motion from a reversal is slow for longer than it is still.
    if count >= max(_MIN_REST_SAMPLES, slow / 2):
        before, after = (half.mean() for half in np.array_split(rest, 2))
        if abs(after - before) <= max(_REST_SHARE * size, 3 * np.sqrt(2) * error):
            return True
    is_end = min(position[0] - position.min(), position.max() - position[0]) <= _REST_SHARE * span
    return bool(is_end and abs(rest.mean()) <= max(_UNLOADED_SHARE * size, 3 * error))
