"""Discrete transfer functions in z⁻¹: poles, stability, free-run simulation, one-step prediction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.base.errors import NumericalError


@dataclass(frozen=True)
class TransferFunction:
    """``y[k] = Σ numerator[j] u[k−j] − Σ denominator[i] y[k−i]`` with ``denominator[0] = 1``."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = (1.0,)
    """`numerator`, `denominator`: coefficients of z⁰, z⁻¹, z⁻², …"""

    def __post_init__(self):
        object.__setattr__(self, "numerator", tuple(map(float, self.numerator)))
        object.__setattr__(self, "denominator", tuple(map(float, self.denominator)))
        if not self.denominator or self.denominator[0] != 1.0:
            raise ValueError(f"denominator[0] is {self.denominator[:1]}, it must be 1")

    @cached_property
    def poles(self) -> np.ndarray:
        """Roots of the denominator in z."""
        return np.roots(self.denominator)

    @cached_property
    def stable(self) -> bool:
        """Whether every coefficient is finite and every pole lies inside the unit circle."""
        if not np.isfinite([*self.numerator, *self.denominator]).all():
            return False
        return bool((np.abs(self.poles) < 1.0).all())

    @property
    def static_gain(self) -> float:
        """Output per unit of an input that is held forever, H(1)."""
        return sum(self.numerator) / sum(self.denominator)

    def scaled(self, gain: float) -> TransferFunction:
        """Return this transfer function times `gain`."""
        return TransferFunction(tuple(gain * value for value in self.numerator), self.denominator)

    def simulate(self, inputs: np.ndarray) -> np.ndarray:
        """Free run: the output from the input alone, started from rest at the first input.

        The system is taken to have been held at ``inputs[0]`` before the record begins, so that a record
        which does not start at zero makes no transient.

        Parameters
        ----------
        inputs : numpy.ndarray, shape (samples,)

        Returns
        -------
        numpy.ndarray, shape (samples,)

        Raises
        ------
        NumericalError
            If the transfer function is unstable: its free run has no meaning.
        """
        from scipy.signal import lfilter

        if not self.stable:
            largest = np.abs(self.poles).max() if np.isfinite(self.denominator).all() else np.inf
            raise NumericalError(
                f"unstable transfer function (largest |pole| {largest:.4g}): it is not simulated"
            )
        held = inputs[0]
        return lfilter(self.numerator, self.denominator, inputs - held) + self.static_gain * held

    def predict_one_step(self, inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """One-step-ahead prediction A x of Eq. 3.6: measured past outputs, no free run.

        Returns
        -------
        numpy.ndarray, shape (samples − largest lag,)
            Predictions of ``outputs[largest lag:]``.
        """
        lag = self.largest_lag
        count = len(inputs) - lag
        moving_average = (b * inputs[lag - j : lag - j + count] for j, b in enumerate(self.numerator))
        autoregression = (
            a * outputs[lag - i : lag - i + count] for i, a in enumerate(self.denominator) if i > 0
        )
        return sum(moving_average, np.zeros(count)) - sum(autoregression, np.zeros(count))

    @property
    def largest_lag(self) -> int:
        """Samples of the past that the recursion needs."""
        return max(len(self.numerator), len(self.denominator)) - 1
