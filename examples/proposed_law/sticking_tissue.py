"""Make tissue tests with a law that no catalogue knows: tissue that sticks to the tool and tears off.

A spring beside a Maxwell branch, and strands that form whenever the tool presses (z > 0), pull it back while it leaves
(1.2 N/mm) and tear 1.1 mm above the surface. Three records of 100 Hz with noise of 0.02 N:

    python examples/proposed_law/sticking_tissue.py recordings/sticking
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

STEP, FINE = 0.01, 20
"""Seconds from sample to sample, and steps of the simulation in each."""
SPRING, BRANCH, TAU, STRANDS, TEAR, NOISE = 0.5, 0.8, 0.15, 1.2, 1.1, 0.02
"""N/mm, N/mm, s, N/mm, mm, N."""


def multisine(time: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Fifty lines from 0.1 to 5 Hz, 5 mm; repeats every 10 s."""
    lines = np.arange(1, 51) * 0.1
    phases = random.uniform(0, 2 * np.pi, len(lines))
    found = np.cos(2 * np.pi * np.outer(time, lines) + phases) @ lines**-0.35
    return 5.0 * found / np.abs(found).max()


def chirp(time: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """From 0.1 to 4 Hz, 5 mm."""
    return 5.0 * np.sin(2 * np.pi * (0.1 + 1.95 * time / time[-1]) * time)


def irregular(time: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Forty lines that never repeat together, 5 mm."""
    lines = random.uniform(0.08, 4.5, 40)
    phases = random.uniform(0, 2 * np.pi, len(lines))
    found = np.cos(2 * np.pi * np.outer(time, lines) + phases) @ lines**-0.35
    return 5.0 * found / np.abs(found).max()


def force(position: np.ndarray) -> np.ndarray:
    """Force at every step of the simulation."""
    branch, stuck, found = 0.0, False, np.empty(len(position))
    decay = np.exp(-STEP / FINE / TAU)
    for k, z in enumerate(position):
        branch = decay * (branch + z - position[max(k - 1, 0)])
        stuck = z > 0 or (stuck and z > -TEAR)
        found[k] = SPRING * z + BRANCH * branch + STRANDS * min(z, 0.0) * stuck
    return found


def main(folder: Path) -> None:
    """Write the records."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(1)
    for name, seconds, motion in (
        ("multisine", 60, multisine),
        ("chirp", 12, chirp),
        ("irregular", 12, irregular),
    ):
        time = np.arange(round(seconds / STEP) * FINE) * STEP / FINE
        position = motion(time, random)
        measured = force(position)[::FINE] + NOISE * random.standard_normal(round(seconds / STEP))
        rows = np.column_stack([time[::FINE], position[::FINE], measured])
        np.savetxt(
            folder / f"{name}.csv", rows, "%.6f", ",", header="time_s,position_mm,force_N", comments=""
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
