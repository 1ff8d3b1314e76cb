"""Whether an input is held between jumps, as a command of a few levels is."""

from __future__ import annotations

import numpy as np

from lumbar.tissue.models.joined_motions import JoinedMotions
from lumbar.tissue.models.motion import Motion

_JUMP = 0.1
"""Share of its range by which an input that is held between jumps typically jumps."""


def is_held(motion: Motion | JoinedMotions) -> bool:
    """Whether an input is held between jumps, as a command of a few levels is; such an input has no derivatives."""
    position = motion.position
    steps = np.abs(np.diff(position))
    moved = steps[steps > 0]
    return moved.size < len(steps) / 2 and bool(np.median(moved) > _JUMP * np.ptp(position))
