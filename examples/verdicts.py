"""Make tissue tests that end in two verdicts: nothing is missing; named, but incomplete.

A Kelvin–Boltzmann tissue at 50 Hz with noise of 0.01 N. In ``incomplete`` it also has dry friction, and a detent every 0.9 mm
that no catalogue knows:

    python examples/verdicts.py cases
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from lumbar.twin.tissue_recordings import tissue_force

STEP = 0.02
LINES = np.arange(1, 11) / 4
"""Hz; a motion of these lines repeats every 4 s."""
TESTS = {"multisine": (24, LINES), "other": (16, LINES * np.sqrt(1.1))}
"""Seconds and Hz of each record."""


def main(folder: Path) -> None:
    """Write the records."""
    random = np.random.default_rng(1)
    for case in ("adequate", "incomplete"):
        (folder / case).mkdir(parents=True, exist_ok=True)
        for name, (seconds, lines) in TESTS.items():
            time = np.arange(0, seconds, STEP)
            turns = 2 * np.pi * (np.outer(time, lines) + random.uniform(size=len(lines)))
            position, speed = np.sin(turns).sum(axis=1), np.cos(turns) @ (2 * np.pi * lines)
            force = tissue_force(time, position, 1.8, 0.9, 0.15, 0.0)
            if case == "incomplete":
                force += 0.4 * np.tanh(speed / 0.5) + 0.02 * np.sin(2 * np.pi * position / 0.9)
            force += 0.01 * random.standard_normal(len(time))
            columns = np.column_stack([time, position, force])
            header = "time_s,position_mm,force_N"
            np.savetxt(folder / case / f"{name}.csv", columns, "%.6f", ",", header=header, comments="")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
