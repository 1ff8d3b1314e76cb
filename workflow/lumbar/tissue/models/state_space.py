"""Discrete state-space form of a transfer function (Eqs 3.17 and 3.18 of the thesis)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lumbar.tissue.models.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control


def observer_form(discrete: TransferFunction, sampling_time: float | bool = True) -> control.StateSpace:
    """Return the observer canonical form, i.e. direct form II transposed.

    Its states are partial sums of the output, so that they have the size of the output; those of the controllable
    canonical form, which `control.ss` makes of a transfer function, are inputs filtered by 1/denominator and grow large
    where poles lie close to z = 1.

    Parameters
    ----------
    sampling_time : float or bool
        Seconds; True where it does not matter.

    Returns
    -------
    control.StateSpace
        With ``discrete.largest_lag`` states, trailing zeros left out.
    """
    import control

    b, a = aligned(discrete)
    order = len(a) - 1
    if not order:
        return control.StateSpace([], [], [], [b], dt=sampling_time)
    matrix = np.eye(order, k=1)
    matrix[:, 0] = -a[1:]
    column, row = b[1:] - a[1:] * b[0], np.eye(1, order)
    return control.StateSpace(
        matrix, column[:, None], row, [[b[0]]], dt=sampling_time, remove_useless_states=False
    )


def aligned(discrete: TransferFunction) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of one length: as powers of z⁻¹ rising, and of z falling. Trailing zeros are left out."""
    parts = [np.trim_zeros(part, "b") for part in (discrete.numerator, discrete.denominator)]
    length = max(map(len, parts))
    numerator, denominator = (np.pad(np.array(part, dtype=float), (0, length - len(part))) for part in parts)
    return numerator, denominator
