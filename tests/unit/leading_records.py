"""Tissue tests whose force is read ahead of the position, or with it: simulated in steps finer than a sample."""

import numpy as np
from periodic_records import STEP, multisine, noise, record
from scipy.signal import lfilter

from lumbar.records.record import Record

FINE = 10
"""Steps of the simulation per sample."""


def leading(lead: int, branch: float = 0.8, hardening: float = 0.0, mass: float = 0.0) -> list[Record]:
    """Spring 0.7 N/mm beside a branch of 0.2 s, the force read so many thousandths of a second before the position."""
    made = []
    for name, seed in (("one", 0), ("two", 3)):
        fine = multisine(5, 1000 * FINE, range(1, 60), seed)
        fine *= 5 / np.abs(fine).max()
        step = STEP / FINE
        pole = np.exp(-step / 0.2)
        moved = np.diff(fine, prepend=fine[0])
        elongation = lfilter([(1 - pole) * 0.2 / step], [1.0, -pole], moved)
        force = 0.7 * fine + branch * elongation + hardening * fine**3
        force += mass * np.gradient(np.gradient(fine, step), step)
        read = np.arange(0, len(fine) - max(FINE, lead), FINE)
        output = force[read + lead] + 0.01 * np.std(force) * noise(len(read), seed + 20)
        made.append(record(fine[read], output, name))
    return made
