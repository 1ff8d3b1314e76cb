"""What the pushes need of a lift as a table: the motion of its links and the levels of the measures, instant by instant."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from lumbar.lifting.pushes.body import LINKS
from lumbar.lifting.pushes.levels import DIRECTIONS, PREDICTORS, Levels
from lumbar.lifting.pushes.motion import DepositMotion

if TYPE_CHECKING:
    import pandas as pd

_MOTION = {"angle": "rad", "rate": "rad_s", "acceleration": "rad_s2"}
_ONE_EACH = (
    "subject",
    "lift",
    "mass_kg",
    "height_m",
    "box_mass_kg",
    "trunk_centre",
    "ankle_height_m",
    "heel_m",
    "toe_m",
)
"""Values that are the same at all instants of a lift."""


def states_frame(motions: Iterable[DepositMotion], levels: Iterable[Levels]) -> pd.DataFrame:
    """Return motions and levels of several lifts, one row per instant."""
    import pandas as pd

    frames = []
    for motion, level in zip(motions, levels, strict=True):
        columns = {"time_s": motion.time}
        for name, unit in _MOTION.items():
            columns |= {f"{link}_{unit}": row for link, row in zip(LINKS, getattr(motion, name), strict=True)}
        columns["shift_m_per_N_s"] = level.shift
        columns |= {f"{name}_{direction}": item for (name, direction), item in level.values.items()}
        frame = pd.DataFrame(columns)
        for name in _ONE_EACH:
            frame[name] = getattr(motion, name)
        for link, length in zip(LINKS, motion.lengths, strict=True):
            frame[f"{link}_m"] = length
        frames.append(frame)
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def from_states(frame: pd.DataFrame) -> tuple[list[DepositMotion], list[Levels]]:
    """Return the motions and levels of a table of `states_frame`."""
    motions, levels = [], []
    if frame.empty:
        return motions, levels
    for _, part in frame.groupby("lift", sort=False):
        first = part.iloc[0]
        moving = {
            name: np.stack([part[f"{link}_{unit}"].to_numpy(float) for link in LINKS])
            for name, unit in _MOTION.items()
        }
        one = {name: first[name] if name in ("subject", "lift") else float(first[name]) for name in _ONE_EACH}
        time = part["time_s"].to_numpy(float)
        lengths = np.array([first[f"{link}_m"] for link in LINKS], dtype=float)
        motions.append(DepositMotion(time=time, lengths=lengths, **moving, **one))
        values = {
            (name, direction): part[f"{name}_{direction}"].to_numpy(float)
            for name in PREDICTORS
            for direction in DIRECTIONS
        }
        levels.append(Levels(time, values, part["shift_m_per_N_s"].to_numpy(float), {}))
    return motions, levels
