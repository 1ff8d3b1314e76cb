"""The motion from a column of velocity: its integral over the record's own clock, and what nobody knows of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lumbar.records.importing.clock import LONGEST_STEP, unrounded
from lumbar.records.record import place_of


def position_of(
    time: np.ndarray, velocity: np.ndarray, keep: np.ndarray, unit: str, lines: Sequence[int] | None = None
) -> tuple[np.ndarray, str]:
    """Integrate a velocity by trapezoids, from 0 at the first sample before which nothing is missing.

    Parameters
    ----------
    time, velocity : numpy.ndarray
        Shape (samples,), of the whole file: parts of it share their zero.
    keep : numpy.ndarray
        Numbers of the samples that are wanted, without a gap among them.
    unit : str
        Of the position.
    lines : sequence of int, optional
        Line of each sample of the file.

    Returns
    -------
    numpy.ndarray
        Shape (kept,): in the velocity's unit times seconds.
    str
        What was done, without the column's name.
    """
    from scipy.integrate import cumulative_trapezoid

    steps = np.diff(time)
    usual = np.median(steps[keep[0] : keep[-1]])
    broken = ~((steps >= 0) & (steps <= LONGEST_STEP * usual) & np.isfinite(velocity[1:] + velocity[:-1]))
    start = int(max(np.flatnonzero(broken[: keep[0]]) + 1, default=0))
    stretch = slice(start, keep[-1] + 1)
    position = cumulative_trapezoid(velocity[stretch], unrounded(time[stretch])[0], initial=0)
    offset = 0.01 * float(np.sqrt(np.mean(velocity[stretch] ** 2)) * (time[keep[-1]] - time[keep[0]]))
    zero = place_of(start, lines) if start else "the first sample"
    return position[keep - start], (
        f"over time (trapezoids between samples), 0 at {zero}: where the tool stood there is not known, and an offset of the "
        f"velocity would be a drift of the position, by {offset:.3g} {unit} to the end for 1 % of its root mean square"
    )
