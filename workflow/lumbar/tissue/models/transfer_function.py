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
    def biproper(self) -> bool:
        """Whether the present input acts at once, as direct feed-through; if not, it is strictly proper."""
        return self.numerator[0] != 0

    @property
    def static_gain(self) -> float:
        """Output per unit of an input that is held forever, H(1)."""
        return sum(self.numerator) / sum(self.denominator)

    def simulate(self, inputs: np.ndarray) -> np.ndarray:
        """Free run: the output from the input alone, started from rest at the first input.

        The system is taken to have been held at ``inputs[0]`` before the record begins, so that a record
        which does not start at zero makes no transient.

        Inputs and output have shape (samples,).

        Raises
        ------
        NumericalError
            If the transfer function is unstable: its free run has no meaning.
        """
        if not self.stable:
            largest = np.abs(self.poles).max() if np.isfinite(self.denominator).all() else np.inf
            raise NumericalError(
                f"unstable transfer function (largest |pole| {largest:.4g}): it is not simulated"
            )
        held = inputs[0]
        return filtered(self.numerator, self.denominator, inputs - held) + self.static_gain * held

    def predict_one_step(self, inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """One-step-ahead prediction A x of Eq. 3.6: measured past outputs, no free run.

        The predictions are of ``outputs[largest lag:]``, shape (samples − largest lag,).
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


def filtered(numerator: Sequence[float], denominator: Sequence[complex], inputs: np.ndarray) -> np.ndarray:
    """Return the output of a transfer function from rest, the outputs substituted forward; all of shape (samples,).

    To rounding as `scipy.signal.lfilter`, whose import takes longer than most signals take here.
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

    Its states are partial sums of the output, so that they have the size of the output; those of the controllable
    canonical form, which `control.ss` makes of a transfer function, are inputs filtered by 1/denominator and grow large
    where poles lie close to z = 1.

    It has ``discrete.largest_lag`` states, trailing zeros left out.
    """
    b, a = aligned_coefficients(discrete)
    order = len(a) - 1
    matrix = np.eye(order, k=1)
    matrix[:, :1] = -a[1:, None]
    column, row = b[1:] - a[1:] * b[0], np.eye(1, order)
    return StateSpace(matrix, column[:, None], row, np.array([[b[0]]]))


def aligned_coefficients(discrete: TransferFunction) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of one length: as powers of z⁻¹ rising, and of z falling. Trailing zeros are left out."""
    parts = [np.trim_zeros(part, "b") for part in (discrete.numerator, discrete.denominator)]
    length = max(map(len, parts))
    numerator, denominator = (np.pad(np.array(part, dtype=float), (0, length - len(part))) for part in parts)
    return numerator, denominator


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

        The result has shape (2·lag + 1, parameter_count); `lag` is the largest of the full vector (y[k−1] … y[k−lag],
        u[k] … u[k−lag]). Multiplying the full regressor matrix by it gives the regressor matrix of this structure.
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

    The result has shape (samples − lag, 2·lag + 1): columns y[k−1] … y[k−lag], u[k] … u[k−lag]; rows k = lag … samples
    − 1.
    """
    count = len(inputs) - lag
    columns = [outputs[lag - i : lag - i + count] for i in range(1, lag + 1)]
    columns += [inputs[lag - j : lag - j + count] for j in range(lag + 1)]
    return np.column_stack(columns)


@dataclass(frozen=True)
class FirstOrder:
    """Coefficients of F + γ Ḟ = k x + ν ẋ.

    Every model of Table 2.1 is a member of this family: linear elastic (ν = γ = 0), Maxwell (k = 0), Kelvin–Voigt
    (γ = 0) and Kelvin–Boltzmann.
    """

    k: float
    """Static stiffness, output unit per input unit."""
    nu: float = 0.0
    """Viscosity, output unit times second per input unit."""
    gamma: float = 0.0
    """Relaxation time, seconds."""

    @classmethod
    def of_base(
        cls,
        spring_stiffness: float = 0.0,
        branch_stiffness: float = 0.0,
        relaxation_time: float = 0.0,
        viscosity: float = 0.0,
    ) -> "FirstOrder":
        """Coefficients of a base of `lumbar.tissue.models.bases` from its parameters; what it does not have is 0."""
        fast = spring_stiffness + branch_stiffness
        return cls(spring_stiffness, viscosity + fast * relaxation_time, relaxation_time)

    def base_parameters(self) -> dict[str, float]:
        """Parameters of the bases LE, Maxwell and KB; a base takes those it has."""
        if not self.gamma:
            return {"spring_stiffness": self.k}
        return {
            "spring_stiffness": self.k,
            "branch_stiffness": self.nu / self.gamma - self.k,
            "relaxation_time": self.gamma,
        }


def undiscretise(discrete: TransferFunction, sampling_time: float) -> FirstOrder:
    """Continuous coefficients whose ramp-invariant form is `discrete`.

    H(s) = ν/γ + (k − ν/γ)/(1 + γ s) becomes ν/γ + (k − ν/γ)(w z + w′)/(z − a) with a = exp(−T/γ): w weighs the present and
    w′ the past position of a ramp. A testing machine moves in ramps from sample to sample, so that the ramp-invariant form
    (triangle or first-order hold; Franklin, Powell and Workman, Digital Control of Dynamic Systems, 3rd ed., section 6.3.3)
    reproduces the continuous force exactly at the samples.

    `discrete` is ``(b0 + b1 z⁻¹)/(1 − a z⁻¹)``, or the static gain ``b0``; `sampling_time` is in seconds.

    Raises
    ------
    NumericalError
        If the pole is not in (0, 1): a relaxation decays without alternating.
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
