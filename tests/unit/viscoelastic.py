"""Springs and dashpots by the formulas of Table 2.1 and by scipy, for the tests of what the library makes of them."""

import numpy as np
from scipy.signal import cont2discrete

from lumbar.tissue.models.tissue_models import Dashpot, Network, Parallel, Spring
from lumbar.tissue.models.transfer_function import FirstOrder, TransferFunction


def maxwell(k: float, b: float) -> FirstOrder:
    """Spring k and dashpot b in series: F + αḞ = b ẋ with α = b/k."""
    return FirstOrder(k=0.0, nu=b, gamma=b / k)


def kelvin_boltzmann(k1: float, k2: float, b: float) -> FirstOrder:
    """Spring k1 parallel to dashpot b, both in series with spring k2."""
    total = k1 + k2
    return FirstOrder(k=k1 * k2 / total, nu=b * k2 / total, gamma=b / total)


def polynomials(system: FirstOrder) -> tuple[list[float], list[float]]:
    """Numerator and denominator in s of F + γ Ḟ = k x + ν ẋ."""
    return [system.nu, system.k], [system.gamma, 1.0]


def discretise(system: FirstOrder, sampling_time: float) -> TransferFunction:
    """Ramp-invariant transfer function by scipy."""
    (numerator,), denominator, _ = cont2discrete(polynomials(system), sampling_time, method="foh")
    return TransferFunction(tuple(numerator), tuple(denominator))


def dynamic_stiffness(network: Network, values: dict[str, float], s: np.ndarray) -> np.ndarray:
    """Force per position of a network at complex frequencies: stiffnesses add in parallel, compliances in series."""
    match network:
        case Spring(symbol):
            return values[symbol] + 0 * s
        case Dashpot(symbol):
            return values[symbol] * s
    parts = [dynamic_stiffness(part, values, s) for part in network.parts]
    return sum(parts) if isinstance(network, Parallel) else 1 / sum(1 / part for part in parts)
