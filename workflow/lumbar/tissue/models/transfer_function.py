"""Discrete transfer functions in z⁻¹: simulation, state space, free coefficients, first-order relaxations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from lumbar.base.errors import NumericalError


@dataclass(frozen=True)
class TransferFunction:
    """``y[k] = Σ numerator[j] u[k−j] − Σ denominator[i] y[k−i]`` with ``denominator[0] = 1``."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = (1.0,)

    def __post_init__(self):
        object.__setattr__(self, "numerator", tuple(map(float, self.numerator)))
        object.__setattr__(self, "denominator", tuple(map(float, self.denominator)))
        if not self.denominator or self.denominator[0] != 1.0:
            raise ValueError(f"denominator[0] is {self.denominator[:1]}, it must be 1")

    @cached_property
    def poles(self) -> np.ndarray:
        """Roots of the denominator in z, shape (poles,)."""
        return np.roots(self.denominator)

    @cached_property
    def stable(self) -> bool:
        """True if every coefficient is finite and every pole is inside the unit circle."""
        is_finite = np.isfinite([*self.numerator, *self.denominator]).all()
        return bool(is_finite and (np.abs(self.poles) < 1.0).all())

    @property
    def biproper(self) -> bool:
        """True if the present input feeds through directly to the output, false if strictly proper."""
        return self.numerator[0] != 0

    @property
    def static_gain(self) -> float:
        """Output per unit of a constant input, H(1)."""
        return sum(self.numerator) / sum(self.denominator)

    def simulate(self, inputs: np.ndarray) -> np.ndarray:
        """Simulate the output from the input only, shape (samples,), at rest at ``inputs[0]`` before the record.

        Parameters
        ----------
        inputs : numpy.ndarray, shape (samples,)
            Input in the unit of the model.

        Raises
        ------
        NumericalError
            If the transfer function is unstable, so that its free run has no meaning.
        """
        if not self.stable:
            largest = np.abs(self.poles).max() if np.isfinite(self.denominator).all() else np.inf
            raise NumericalError(
                f"unstable transfer function (largest |pole| {largest:.4g}): it is not simulated"
            )
        first = inputs[0]
        return filtered(self.numerator, self.denominator, inputs - first) + self.static_gain * first

    def predict_one_step(self, inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Predict ``outputs[largest lag:]``, shape (samples - largest lag,), one step ahead from past outputs: A x of Eq. 3.6.

        Parameters
        ----------
        inputs, outputs : numpy.ndarray, shape (samples,)
            Measured input and output in the units of the model.
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
        """Number of past samples in the recursion."""
        return max(len(self.numerator), len(self.denominator)) - 1


def filtered(numerator: Sequence[float], denominator: Sequence[complex], inputs: np.ndarray) -> np.ndarray:
    """Return the output of a transfer function from rest by forward substitution.

    Equal to `scipy.signal.lfilter` up to rounding, but without its slow import.

    Parameters
    ----------
    numerator, denominator : sequence of float or complex
        Coefficients in rising powers of z⁻¹; ``denominator[0]`` is not 0.
    inputs : numpy.ndarray, shape (samples,)
        Input in any unit; the result has the same shape.
    """
    forth, back = (np.asarray(side) / denominator[0] for side in (numerator, denominator))
    driven = forth[0] * inputs if len(forth) == 1 else np.convolve(forth, inputs)[: len(inputs)]
    if len(back) == 1:
        return driven
    bands = np.tile(back, (len(inputs), 1)).T
    (substituted,) = scipy.linalg.get_lapack_funcs(("tbtrs",), (bands, driven))
    return substituted(bands, driven[:, None], uplo="L", diag="U", overwrite_b=True)[0][:, 0]


class StateSpace(NamedTuple):
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]; shapes (n, n), (n, 1), (1, n) and (1, 1)."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    @property
    def nstates(self) -> int:
        """Number of states."""
        return len(self.A)

    def poles(self) -> np.ndarray:
        """Eigenvalues of A, complex; shape (n,)."""
        return np.linalg.eigvals(self.A).astype(complex)


def observer_form(discrete: TransferFunction) -> StateSpace:
    """Return the observer canonical form (Eqs 3.17 and 3.18 of the thesis), i.e. direct form II transposed.

    Its states, partial sums of the output, have the size of the output; the states of the controllable form of `control.ss`
    grow large if poles are close to z = 1. There are ``discrete.largest_lag`` states, without trailing zeros.

    Parameters
    ----------
    discrete : TransferFunction
        Any transfer function.
    """
    b, a = aligned_coefficients(discrete)
    order = len(a) - 1
    matrix = np.eye(order, k=1)
    matrix[:, :1] = -a[1:, None]
    column, row = b[1:] - a[1:] * b[0], np.eye(1, order)
    return StateSpace(matrix, column[:, None], row, np.array([[b[0]]]))


def aligned_coefficients(discrete: TransferFunction) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator, shape (largest lag + 1,), in rising powers of z⁻¹, without common trailing zeros.

    Parameters
    ----------
    discrete : TransferFunction
        Any transfer function.
    """
    parts = [np.trim_zeros(part, "b") for part in (discrete.numerator, discrete.denominator)]
    length = max(map(len, parts))
    numerator, denominator = (np.pad(np.array(part, dtype=float), (0, length - len(part))) for part in parts)
    return numerator, denominator


@dataclass(frozen=True)
class ArxStructure:
    """Free coefficients of H(z)."""

    order: int
    """Number of lags of the output, i.e. of poles (n of Eq. 3.9)."""
    input_lags: tuple[int, ...]
    """Lags of the input, increasing; 0 makes the transfer function biproper."""
    zero_static_gain: bool = False
    """True if the numerator coefficients sum to zero, i.e. H(1) = 0: only changes of the input act."""

    @property
    def parameter_count(self) -> int:
        """Number of free coefficients."""
        return self.order + len(self.input_lags) - self.zero_static_gain

    @property
    def largest_lag(self) -> int:
        """Number of past samples in the recursion."""
        return max(self.order, *self.input_lags)

    def combination(self, lag: int) -> np.ndarray:
        """Return the matrix from free coefficients to coefficients of all lags: y[k−1] … y[k−lag], u[k] … u[k−lag].

        The full regressor matrix times this matrix is the regressor matrix of this structure. Shape (2 * lag + 1,
        parameter_count), elements -1, 0 and 1.

        Parameters
        ----------
        lag : int
            Number of past samples of the full regressor vector, at least `largest_lag`.
        """
        matrix = np.zeros((2 * lag + 1, self.parameter_count))
        np.fill_diagonal(matrix[: self.order, : self.order], 1.0)
        rows, columns = lag + np.array(self.input_lags), np.arange(self.order, self.parameter_count)
        if self.zero_static_gain:
            # u[k−first] − u[k−other]: differences of the input carry no static gain.
            matrix[rows[0], columns] = 1.0
            matrix[rows[1:], columns] = -1.0
        else:
            matrix[rows, columns] = 1.0
        return matrix

    def transfer_function(self, coefficients: np.ndarray) -> TransferFunction:
        """Return the transfer function with these free coefficients.

        Parameters
        ----------
        coefficients : numpy.ndarray, shape (parameter_count,)
            Free coefficients: of the output, then of the input.
        """
        lag = self.largest_lag
        full = self.combination(lag) @ coefficients
        numerator = full[lag : lag + max(self.input_lags) + 1]
        return TransferFunction(tuple(numerator), (1.0, *(-full[: self.order])))

    def coefficients(self, transfer_function: TransferFunction) -> np.ndarray:
        """Return the free coefficients of a transfer function of this structure, shape (parameter_count,).

        Parameters
        ----------
        transfer_function : TransferFunction
            Transfer function of this structure.

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
    """Return the regressor matrix of Eq. 3.6 with all lags up to a largest one.

    Shape (samples - lag, 2 * lag + 1): columns are y[k−1] … y[k−lag], u[k] … u[k−lag]; rows are k = lag … samples − 1.

    Parameters
    ----------
    inputs, outputs : numpy.ndarray, shape (samples,)
        Measured input u and output y.
    lag : int
        Largest lag, in samples.
    """
    count = len(inputs) - lag
    columns = [outputs[lag - i : lag - i + count] for i in range(1, lag + 1)]
    columns += [inputs[lag - j : lag - j + count] for j in range(lag + 1)]
    return np.column_stack(columns)


@dataclass(frozen=True)
class FirstOrder:
    """Coefficients of F + γ Ḟ = k x + ν ẋ: linear elastic (ν = γ = 0), Maxwell (k = 0), Kelvin–Voigt (γ = 0) or KB."""

    k: float
    """Static stiffness, output unit per input unit."""
    nu: float = 0.0
    """Viscosity, output unit times second per input unit."""
    gamma: float = 0.0
    """Relaxation time, seconds."""

    @classmethod
    def from_base(
        cls,
        spring_stiffness: float = 0.0,
        branch_stiffness: float = 0.0,
        relaxation_time: float = 0.0,
        viscosity: float = 0.0,
    ) -> "FirstOrder":
        """Return the coefficients of a base of `lumbar.tissue.models.bases`; parameters that it does not have are 0.

        Parameters
        ----------
        spring_stiffness, branch_stiffness : float, optional
            Stiffness of the spring and of the Maxwell branch, output unit per input unit.
        relaxation_time : float, optional
            Relaxation time of the branch in seconds.
        viscosity : float, optional
            Viscosity of a dashpot parallel to the spring, output unit times second per input unit.
        """
        fast = spring_stiffness + branch_stiffness
        return cls(spring_stiffness, viscosity + fast * relaxation_time, relaxation_time)


def undiscretise(discrete: TransferFunction, sampling_time: float) -> FirstOrder:
    """Return the continuous coefficients of which `discrete` is the ramp-invariant form.

    H(s) = ν/γ + (k − ν/γ)/(1 + γ s) becomes ν/γ + (k − ν/γ)(w z + w′)/(z − a) with a = exp(−T/γ) and weights w, w′ of the
    present and past position of a ramp. This form (first-order hold; Franklin, Powell and Workman, Digital Control of Dynamic
    Systems, 3rd ed., section 6.3.3) is exact at the samples for a testing machine that moves in ramps between them.

    Parameters
    ----------
    discrete : TransferFunction
        ``(b0 + b1 z⁻¹)/(1 − a z⁻¹)``, or the static gain ``b0``.
    sampling_time : float
        T in seconds.

    Raises
    ------
    NumericalError
        If there is not one pole with two numerator coefficients, or the pole is not in (0, 1), as a relaxation requires.
    """
    if discrete.largest_lag == 0:
        return FirstOrder(k=discrete.static_gain)
    if len(discrete.denominator) != 2 or len(discrete.numerator) != 2:
        raise NumericalError("a first-order relaxation has one pole and two numerator coefficients")
    pole = -discrete.denominator[1]
    if not 0.0 < pole < 1.0:
        raise NumericalError(
            f"the discrete pole is {pole:.4g}: only a pole in (0, 1) belongs to a relaxation exp(−T/γ)"
        )
    gamma = -sampling_time / math.log(pole)
    # 1 − w, without cancellation for slow relaxations.
    decay = -math.expm1(-sampling_time / gamma) / (sampling_time / gamma)
    stiffness = discrete.static_gain
    instant = (discrete.numerator[0] - stiffness * (1.0 - decay)) / decay
    return FirstOrder(k=stiffness, nu=instant * gamma, gamma=gamma)
