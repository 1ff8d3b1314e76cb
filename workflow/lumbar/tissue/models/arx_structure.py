"""Structures of discrete models: which lags of input and output enter, and what ties their coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lumbar.tissue.models.transfer_function import TransferFunction


@dataclass(frozen=True)
class ArxStructure:
    """Which coefficients of H(z) are free."""

    order: int
    """Lags of the output, i.e. poles (n of Eq. 3.9)."""
    input_lags: tuple[int, ...]
    """Lags of the input, increasing; 0 makes the transfer function biproper."""
    zero_static_gain: bool = False
    """Whether the numerator coefficients sum to zero, i.e. H(1) = 0: only changes of the input act."""

    @property
    def parameter_count(self) -> int:
        """Number of free coefficients."""
        return self.order + len(self.input_lags) - self.zero_static_gain

    @property
    def largest_lag(self) -> int:
        """Samples of the past that enter."""
        return max(self.order, *self.input_lags)

    def combination(self, lag: int) -> np.ndarray:
        """Matrix from free coefficients to those of the full regressor vector.

        Parameters
        ----------
        lag : int
            Largest lag of the full vector (y[k−1] … y[k−lag], u[k] … u[k−lag]).

        Returns
        -------
        numpy.ndarray, shape (2·lag + 1, parameter_count)
            Multiplying the full regressor matrix by it gives the regressor matrix of this structure.
        """
        matrix = np.zeros((2 * lag + 1, self.parameter_count))
        for column in range(self.order):
            matrix[column, column] = 1.0
        first, *others = self.input_lags
        columns = range(self.order, self.parameter_count)
        if self.zero_static_gain:
            # u[k−first] − u[k−other]: differences of the input carry no static gain.
            for column, other in zip(columns, others, strict=True):
                matrix[lag + first, column] = 1.0
                matrix[lag + other, column] = -1.0
        else:
            for column, input_lag in zip(columns, self.input_lags, strict=True):
                matrix[lag + input_lag, column] = 1.0
        return matrix

    def transfer_function(self, coefficients: np.ndarray) -> TransferFunction:
        """Transfer function with these free coefficients."""
        lag = self.largest_lag
        full = self.combination(lag) @ coefficients
        numerator = full[lag : lag + max(self.input_lags) + 1]
        return TransferFunction(tuple(numerator), (1.0, *(-full[: self.order])))

    def coefficients(self, transfer_function: TransferFunction) -> np.ndarray:
        """Free coefficients of a transfer function that has this structure.

        Raises
        ------
        ValueError
            If the transfer function is not of this structure.
        """
        lag = max(self.largest_lag, transfer_function.largest_lag)
        full = np.zeros(2 * lag + 1)
        full[: len(transfer_function.denominator) - 1] = -np.array(transfer_function.denominator[1:])
        full[lag : lag + len(transfer_function.numerator)] = transfer_function.numerator
        combination = self.combination(lag)
        free, *_ = np.linalg.lstsq(combination, full)
        if not np.allclose(combination @ free, full, rtol=1e-9, atol=1e-12 * (1 + np.abs(full).max())):
            raise ValueError(f"{transfer_function} does not have {self}")
        return free


def full_regressors(inputs: np.ndarray, outputs: np.ndarray, lag: int) -> np.ndarray:
    """Regressor matrix of Eq. 3.6 with every lag up to `lag`.

    Returns
    -------
    numpy.ndarray, shape (samples − lag, 2·lag + 1)
        Columns y[k−1] … y[k−lag], u[k] … u[k−lag]; rows k = lag … samples − 1.
    """
    count = len(inputs) - lag
    columns = [outputs[lag - i : lag - i + count] for i in range(1, lag + 1)]
    columns += [inputs[lag - j : lag - j + count] for j in range(lag + 1)]
    return np.column_stack(columns)
