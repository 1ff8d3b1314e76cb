"""Discrete state-space form of an identified transfer function (Eqs 3.17 and 3.18 of the thesis)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.errors import InputError


@dataclass(frozen=True)
class StateSpace:
    """``x[k+1] = A x[k] + B u[k]``, ``y[k] = C x[k] + D u[k]`` (Eqs 3.17 and 3.18): one input, one output.

    Attributes
    ----------
    A : numpy.ndarray, shape (states, states)
    B, C : numpy.ndarray, shape (states,)
    D : float
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: float

    @property
    def states(self) -> int:
        """Number of states; 0 for a static gain."""
        return len(self.B)

    @property
    def largest_pole(self) -> float:
        """Largest magnitude of an eigenvalue of A; 0 without states."""
        return float(np.abs(np.linalg.eigvals(self.A)).max()) if self.states else 0.0

    @property
    def stable(self) -> bool:
        """Whether all poles lie strictly inside the unit circle."""
        return self.largest_pole < 1.0


def from_transfer_function(numerator, denominator, name: str = "model") -> StateSpace:
    """Return the observer canonical form, i.e. direct form II transposed.

    Its states are partial sums of the output, so that they have the size of the output; those of the
    controllable canonical form are inputs filtered by 1/denominator, which grow large where poles lie close
    to z = 1.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients of z⁰, z⁻¹, z⁻², …
    name : str
        Stands in messages.

    Returns
    -------
    StateSpace
        With ``max(len(numerator), len(denominator)) − 1`` states, trailing zeros left out.

    Raises
    ------
    InputError
        A coefficient is missing or not finite, or ``denominator[0]`` is 0 (improper: it needs future inputs).
    """
    b, a = np.array(numerator, dtype=float), np.array(denominator, dtype=float)
    for label, values in (("numerator", b), ("denominator", a)):
        if values.ndim != 1 or not values.size:
            raise InputError(f"{name}: {label} has no coefficients; at least one is needed")
        if not np.isfinite(values).all():
            raise InputError(f"{name}: {label} is {values.tolist()}; every coefficient must be finite")
    if a[0] == 0.0:
        raise InputError(
            f"{name}: denominator[0] is 0: improper, it needs future positions; fit it with a delay"
        )
    b, a = b / a[0], a / a[0]
    order = max(_last_nonzero(b), _last_nonzero(a))
    b, a = (np.pad(values[: order + 1], (0, max(0, order + 1 - len(values)))) for values in (b, a))
    matrix = np.eye(order, k=1)
    if order:
        matrix[:, 0] = -a[1:]
    output = np.zeros(order)
    output[:1] = 1.0
    return StateSpace(A=matrix, B=b[1:] - a[1:] * b[0], C=output, D=float(b[0]))


def _last_nonzero(values: np.ndarray) -> int:
    nonzero = np.flatnonzero(values)
    return int(nonzero[-1]) if nonzero.size else 0
