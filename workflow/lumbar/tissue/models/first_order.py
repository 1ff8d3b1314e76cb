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

from lumbar.base.errors import NumericalError
from lumbar.tissue.models.transfer_function import TransferFunction


@dataclass(frozen=True)
class FirstOrder:
    """Coefficients of F + γ Ḟ = k x + ν ẋ."""

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
    ) -> FirstOrder:
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
    w′ the past position of a ramp.

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
    # 1 − w, without cancellation for slow relaxations.
    decay = -math.expm1(-sampling_time / gamma) / (sampling_time / gamma)
    stiffness = discrete.static_gain
    instant = (discrete.numerator[0] - stiffness * (1.0 - decay)) / decay
    return FirstOrder(k=stiffness, nu=instant * gamma, gamma=gamma)
