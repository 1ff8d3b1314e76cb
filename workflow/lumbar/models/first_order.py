"""The relaxation F + γ Ḟ = k x + ν ẋ between continuous and discrete time, exact for piecewise-linear motion.

Every model of Table 2.1 is a member of this family: linear elastic (ν = γ = 0), Maxwell (k = 0), Kelvin–Voigt
(γ = 0) and Kelvin–Boltzmann. A testing machine moves in ramps from sample to sample, so the discretisation
used throughout is the ramp-invariant one (triangle or first-order hold; Franklin, Powell and Workman, Digital
Control of Dynamic Systems, 3rd ed., section 6.3.3), which reproduces the continuous force exactly at the
samples of such a motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lumbar.errors import InputError, NumericalError
from lumbar.models.transfer_function import TransferFunction


@dataclass(frozen=True)
class FirstOrder:
    """Coefficients of F + γ Ḟ = k x + ν ẋ.

    Attributes
    ----------
    k : float
        Static stiffness, output unit per input unit.
    nu : float
        Viscosity, output unit times second per input unit.
    gamma : float
        Relaxation time, seconds.
    """

    k: float
    nu: float = 0.0
    gamma: float = 0.0

    @classmethod
    def of_base(
        cls,
        spring_stiffness: float = 0.0,
        branch_stiffness: float = 0.0,
        relaxation_time: float = 0.0,
        viscosity: float = 0.0,
    ) -> FirstOrder:
        """Coefficients of a base of `lumbar.models.bases` from its parameters; what it does not have is 0."""
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


def _ramp_weights(gamma: float, sampling_time: float) -> tuple[float, float, float]:
    """Pole, and weights of u[k−1] and u[k], of the ramp-invariant 1/(1 + γ s)."""
    ratio = sampling_time / gamma
    pole = math.exp(-ratio)
    mean_decay = -math.expm1(-ratio) / ratio  # (1 − a)/(T/γ) without cancellation for slow relaxations
    return pole, mean_decay - pole, 1.0 - mean_decay


def discretise(system: FirstOrder, sampling_time: float) -> TransferFunction:
    """Ramp-invariant discrete transfer function of a first-order relaxation.

    Parameters
    ----------
    system : FirstOrder
        Continuous coefficients, γ ≥ 0.
    sampling_time : float
        Seconds.

    Raises
    ------
    InputError
        If γ = 0 while ν ≠ 0: (k + ν s) is improper (eq. 3.5) and has no force at the samples of a ramp's
        corner.
    """
    if system.gamma < 0 or sampling_time <= 0:
        raise InputError(
            f"relaxation time {system.gamma:g} s, sampling time {sampling_time:g} s: need ≥ 0 and > 0"
        )
    if system.gamma == 0:
        if system.nu != 0:
            raise InputError(
                "a spring and dashpot in parallel (Kelvin–Voigt) form an improper transfer function "
                "b1·z − b0 (eq. 3.5): its force needs the next position; take a model with a relaxation time"
            )
        return TransferFunction((system.k,))
    pole, weight_before, weight_now = _ramp_weights(system.gamma, sampling_time)
    instant = system.nu / system.gamma  # H(s) = ν/γ + (k − ν/γ)/(1 + γ s)
    relaxing = system.k - instant
    numerator = (instant + relaxing * weight_now, -instant * pole + relaxing * weight_before)
    return TransferFunction(numerator, (1.0, -pole))


def undiscretise(discrete: TransferFunction, sampling_time: float) -> FirstOrder:
    """Continuous coefficients whose ramp-invariant form is `discrete`: the inverse of `discretise`.

    Parameters
    ----------
    discrete : TransferFunction
        ``(b0 + b1 z⁻¹)/(1 − a z⁻¹)``, or the static gain ``b0``.
    sampling_time : float
        Seconds.

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
    _, _, weight_now = _ramp_weights(gamma, sampling_time)
    stiffness = discrete.static_gain
    instant = (discrete.numerator[0] - stiffness * weight_now) / (1.0 - weight_now)
    return FirstOrder(k=stiffness, nu=instant * gamma, gamma=gamma)
