"""Does a difference of Table 4.1 survive? One sentence per percentage, by stated rules.

A percentage *survives* when it keeps its sign under every change of Q, R and b, with the other sign of gravity,
with the other convention for the box's mass and with the sine's Taylor polynomials, and when the movement itself
accounts for at least `MOVEMENT_SHARE` of it: the null control, in which every trajectory stands still at θ0 = 0
and only durations, masses and lengths differ, must not show it too.
"""

from __future__ import annotations

import numpy as np

MOVEMENT_SHARE = 0.5
FEWEST_TRIALS = 3
"""Trials of each side below which a bootstrap says nothing."""
RESAMPLES = 2000


def verdict(percent: float | None, null: float | None, changed: dict[str, float | None], interval) -> str:
    """Return the sentence.

    Parameters
    ----------
    percent : float or None
        The percentage; None where the study cannot tell.
    null : float or None
        That of the null control.
    changed : dict of str to float
        The percentage under each change, by its name.
    interval : tuple of float, or None
        Bootstrap interval over trials, where there are enough.
    """
    if percent is None:
        return "not testable in this study"
    movement = 1.0 if null is None else (percent - null) / percent if percent else 0.0
    turned = [name for name, value in changed.items() if value is not None and value * percent <= 0]
    reasons = []
    if turned:
        reasons.append(f"its sign turns with {', '.join(turned)}")
    if movement < MOVEMENT_SHARE:
        reasons.append(
            f"the null control shows {null:+.2f} % of the {percent:+.2f} %: it tells of duration, mass and length"
        )
    unknown = [name for name, value in changed.items() if value is None]
    if null is None:
        unknown.append("the null control")
    if unknown:
        reasons.append(f"no basin with {', '.join(unknown)}")
    if interval is not None and interval[0] <= 0 <= interval[1]:
        reasons.append("its interval over trials contains 0")
    trials = (
        "one or two trials: no interval"
        if interval is None
        else f"95 % interval over trials [{interval[0]:+.2f}, {interval[1]:+.2f}] %"
    )
    if reasons:
        return f"does not survive: {'; '.join(reasons)} ({trials})"
    return f"survives null control, sensitivity and sign ({trials})"


def bootstrap_percent(before: np.ndarray, after: np.ndarray, seed: int) -> tuple[float, float] | None:
    """Return the 95 % percentile interval of 100(Ā_after − Ā_before)/Ā_before over trials.

    Parameters
    ----------
    before, after : numpy.ndarray, shape (trials,)
        Areas of single trials.
    seed : int

    Returns
    -------
    tuple of float, or None
        None with fewer than `FEWEST_TRIALS` trials on either side ("insufficient data").
    """
    if min(len(before), len(after)) < FEWEST_TRIALS:
        return None
    generator = np.random.default_rng(seed)
    means = [generator.choice(values, (RESAMPLES, len(values))).mean(axis=1) for values in (before, after)]
    low, high = np.quantile(100 * (means[1] - means[0]) / means[0], [0.025, 0.975])
    return float(low), float(high)
