"""Which push next: the one after which a person's thresholds are expected to be known best, within what is safe.

With two outcomes the variance of every log threshold after a push is known before it, from draws of what is open: it is the
mean of those among draws weighted by the chance of either outcome. The push taken is the one of all allowed that makes the
mean over directions and phases smallest (the Ψ method of Kontsevich & Tyler 1999, with the variance for the entropy). Allowed is
no size above what was declared, nor more than a step above the largest after which the person stood in that direction.
"""

from dataclasses import dataclass

import numpy as np

from lumbar.lifting.pushes.dose_response import Posterior, PushRecords, chance, log_odds

SIZES = 25
"""Tried between smallest and largest, in even ratios."""


@dataclass(frozen=True)
class NextPush:
    """A push to give, and what is expected of it."""

    person: str
    direction: str
    phase: float
    impulse_N_s: float
    chance: float
    """Of a step."""
    sd_now: float
    sd_after: float
    """`sd_now`, `sd_after`: root of the mean variance of ln threshold over directions and phases; after it as expected."""

    def __str__(self) -> str:
        return (
            f"next push of {self.person}: {self.direction}, {self.impulse_N_s:.3g} N·s, at phase {self.phase:g} (chance of a "
            f"step {100 * self.chance:.0f} %); standard deviation of thresholds now {100 * self.sd_now:.1f} %, expected after "
            f"it {100 * self.sd_after:.1f} %"
        )


def next_push(records: PushRecords, posterior: Posterior, person: str, step: float, seed=0) -> NextPush:
    """Choose the next push of a person; one who was never pushed begins with the smallest size.

    `step` is how many times the largest size after which the person stood may be given.
    """
    known = person in records.persons
    own = records.persons.index(person) if known else -1
    t = posterior.log_threshold[:, own] if known else posterior.someone(seed)
    options = []
    for direction, (low, high) in enumerate(records.ranges):
        stood = records.size[(records.person == own) & (records.direction == direction) & ~records.stepped]
        # Other sizes each time: repeats of a size bracket a threshold no further.
        shares = (np.arange(SIZES) + 0.618 * len(records.size) % 1) / SIZES
        most, sizes = max(low, step * stood.max(initial=0.0)), np.r_[low, low * (high / low) ** shares]
        options += [(direction, phase, size) for size in sizes[sizes <= most] for phase in records.phases]
    way, phase, size = (np.array(item) for item in zip(*options, strict=True))
    curve = t[:, way], phase, posterior.phase[:, way], posterior.width[:, way]
    chances = chance(log_odds(np.log(size), *curve)).T
    later = posterior.phase[:, :, None] * (np.array(records.phases) - 0.5)
    sought = (t[:, :, None] + later).reshape(len(t), -1)
    after = expected_variance(chances, sought).mean(axis=1)
    best = int(np.argmin(after))
    numbers = (
        phase[best],
        size[best],
        chances[best].mean(),
        sought.var(axis=0).mean() ** 0.5,
        after[best] ** 0.5,
    )
    return NextPush(person, records.directions[way[best]], *map(float, numbers))


def expected_variance(chances: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Variances of t, shape (draws, directions), expected after pushes with chances of a step (pushes, draws)."""
    t = t - t.mean(axis=0)
    explained = 0.0
    for share in (chances, 1 - chances):
        explained = explained + (share @ t / len(t)) ** 2 / share.mean(axis=1)[:, None]
    return (t**2).mean(axis=0) - explained
