"""Does a difference of Table 4.1 survive? One sentence per percentage, by stated rules.

A percentage *survives* when it keeps its sign under every change of Q, R and b, with the other sign of gravity,
with the other convention for the box's mass and with the sine's Taylor polynomials, and when the movement itself
accounts for at least `MOVEMENT_SHARE` of it: the null control, in which every trajectory stands still at θ0 = 0
and only durations, masses and lengths differ, must not show it too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lumbar.lifting.population.contrast import Interval

MOVEMENT_SHARE = 0.5


def verdict(
    percent: float | None, null: float | None, changed: dict[str, float | None], interval: Interval
) -> str:
    """Return the sentence.

    Parameters
    ----------
    percent : float or None
        The percentage; None where the study cannot tell.
    null : float or None
        That of the null control.
    changed : dict of str to float
        The percentage under each change, by its name.
    interval : Interval
        Over persons, where there are enough.
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
    if interval.known and interval.low <= 0 <= interval.high:
        reasons.append("its interval over persons contains 0")
    certainty = (
        f"95 % interval over persons [{interval.low:+.2f}, {interval.high:+.2f}] %"
        if interval.known
        else interval.remark
    )
    if reasons:
        return f"does not survive: {'; '.join(reasons)} ({certainty})"
    return f"survives null control, sensitivity and sign ({certainty})"
