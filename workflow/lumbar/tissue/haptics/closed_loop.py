"""The loop of model, hold, device and hand, exact at the sample instants: its poles and its largest stable gain.

Device and hand are linear and the force is held, so that the loop is a difference equation without approximation
(zero-order hold; K. J. Åström and B. Wittenmark, Computer-Controlled Systems, 3rd ed., chapter 3).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.models.transfer_function import TransferFunction

_SMALLEST_ANGLE, _SLOWEST = 1e-4, 1e-6
_NEAR = np.sinh(np.linspace(-4.0, 4.0, 33))
"""Angles near a pole, in multiples of its distance to the unit circle."""
_LONG = 64
"""Coefficients that are summed at once."""
_ROUNDING = 1e-9
"""Share of a numerator's coefficients below which their sum is 0."""


def all_angles(points: int = 2000, smallest: float = _SMALLEST_ANGLE) -> np.ndarray:
    """Angles ωT from near 0 to π: evenly spaced, and closer and closer towards 0, where slow relaxations lie."""
    slow = np.geomspace(smallest, np.pi / points, points // 4)
    return np.concatenate([slow[:-1], np.linspace(slow[-1], np.pi, points)])


def angles_near(poles: np.ndarray) -> np.ndarray:
    """Angles in (0, π) about those of poles, as dense as a resonance of each is narrow."""
    # Once for both of a conjugate pair.
    near = np.unique(np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * _NEAR)
    return near[(near > 0.0) & (near < np.pi)]


def _polynomial(coefficients: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Polynomial in z⁻¹ at exp(jθ); by single powers where most have none, as after a delay or in a model that is held."""
    powers = np.flatnonzero(coefficients)
    if 4 * len(powers) < len(coefficients):
        return np.exp(-1j * np.multiply.outer(angles, powers)) @ coefficients[powers]
    if len(coefficients) <= _LONG:
        return np.polyval(coefficients[::-1], np.exp(-1j * np.asarray(angles)))
    # Horner's rule takes a step of Python a coefficient: here rows of coefficients, then their sums at the powers between.
    rows = np.pad(coefficients, (0, -len(coefficients) % _LONG)).reshape(-1, _LONG)
    within = np.exp(-1j * np.multiply.outer(angles, np.arange(_LONG)))
    between = np.exp(-1j * np.multiply.outer(angles, _LONG * np.arange(len(rows))))
    return ((within.real @ rows.T + 1j * (within.imag @ rows.T)) * between).sum(-1)


@dataclass(frozen=True)
class SampledModel:
    """H(z) from sampled positions to the force that pushes back, held for one sampling time."""

    name: str
    numerator: np.ndarray
    denominator: np.ndarray
    """`numerator`, `denominator`: coefficients of z⁰, z⁻¹, …, in N/m; positive where the force is against the motion.
    Moving average and delays of whole samples are in them."""
    sampling_time: float
    """Seconds between two samples."""
    delay: float = 0.0
    """Seconds from a sample to the force that follows from it, less than `sampling_time`."""

    def response(self, angles: np.ndarray) -> np.ndarray:
        """H(exp(jθ)) at angles θ = ωT in radians, without `delay`; shape of `angles`, complex."""
        return _polynomial(self.numerator, angles) / _polynomial(self.denominator, angles)

    @property
    def poles(self) -> np.ndarray:
        """Roots of the denominator in z, without those at 0."""
        # A model that runs several times over between two of its own samples has powers of z⁻ʰ alone: roots in zʰ are exact.
        held = max(int(np.gcd.reduce(np.flatnonzero(self.denominator))), 1)
        roots = np.roots(np.trim_zeros(self.denominator[::held], "b")).astype(complex)
        return np.multiply.outer(roots ** (1.0 / held), np.exp(2j * np.pi * np.arange(held) / held)).ravel()

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return bool((np.abs(self.poles) < 1.0).all())

    @property
    def static_stiffness(self) -> float:
        """H(1) in N/m: the force by which a position that stays is resisted in the end; negative where it is helped."""
        total = self.numerator.sum()
        return (
            0.0 if abs(total) < _ROUNDING * np.abs(self.numerator).sum() else total / self.denominator.sum()
        )

    @classmethod
    def of(cls, name: str, structure: TransferFunction, sampling_time: float) -> Self:
        """A transfer function as a model."""
        return cls(name, np.array(structure.numerator), np.array(structure.denominator), sampling_time)

    def scaled(self, factor: float) -> Self:
        """The model with its force times a factor."""
        return replace(self, numerator=factor * self.numerator)

    def late(self, seconds: float) -> Self:
        """The model with its force later by this time."""
        whole, part = divmod(self.delay + seconds, self.sampling_time)
        if self.sampling_time - part < 1e-9 * self.sampling_time:
            whole, part = whole + 1, 0.0
        part = part if part > 1e-9 * self.sampling_time else 0.0
        return replace(self, numerator=np.concatenate([np.zeros(int(whole)), self.numerator]), delay=part)


def propagation(device: DeviceSettings, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact motion of device and hand over a time in which all forces are held.

    Parameters
    ----------
    device : DeviceSettings
        m ẍ + b ẋ + k x = f, with mass and damping of stylus and hand and the stiffness of the hand.

    Returns
    -------
    transition : numpy.ndarray, shape (2, 2)
        Of position in m and velocity in m/s.
    by_force : numpy.ndarray, shape (2,)
        What one newton adds to them.
    """
    mass = device.mass_kg + device.hand_mass_kg
    damping = device.damping_N_s_m + device.hand_damping_N_s_m
    held = np.zeros((3, 3))
    held[0, 1], held[1] = 1.0, (-device.hand_stiffness_N_m / mass, -damping / mass, 1.0 / mass)
    exact = scipy.linalg.expm(held * seconds)
    return exact[:2, :2], exact[:2, 2]


def loop_response(model: SampledModel, device: DeviceSettings) -> Callable[[np.ndarray], np.ndarray]:
    """Open-loop frequency response: the model times the sampled response of device and hand to its held force.

    Returns
    -------
    callable
        From angles ωT in radians to complex numbers of the same shape; the closed loop has a pole at exp(jωT) where they
        are −1.
    """
    # Over a sampling time the force before acts first, then the new one.
    rest, by_new = propagation(device, model.sampling_time - model.delay)
    first, by_old = propagation(device, model.delay)
    transition, by_old = rest @ first, rest @ by_old
    # Row (1, 0) · (z − Φ)⁻¹ by Cramer's rule: Φ is two by two.
    trace, determinant = transition[0, 0] + transition[1, 1], np.linalg.det(transition)

    def response(angles: np.ndarray) -> np.ndarray:
        forward = np.exp(1j * np.asarray(angles))
        driven_by = [
            (forward - transition[1, 1]) * column[0] + transition[0, 1] * column[1]
            for column in (by_new, by_old)
        ]
        across = forward**2 - trace * forward + determinant
        return model.response(angles) * (driven_by[0] + driven_by[1] / forward) / across

    return response


def largest_stable_gain(model: SampledModel, device: DeviceSettings) -> tuple[float, float]:
    """Largest factor on the model's force below which the loop is stable for every factor from 0 on.

    Where the loop's frequency response meets the negative real axis at −r, a factor 1/r puts a pole on the unit circle; device
    and hand alone and the model alone are stable, so that the first such factor is the end of the stable ones. It meets the axis
    at z = −1, at z = 1, where a negative static stiffness overcomes the hand, and in between.

    A stylus that nobody holds (a hand without stiffness) stays where it is left, which is no instability: without static
    stiffness of the model the pole z = 1 of its place is left out, with a negative one no factor is stable.

    Returns
    -------
    gain : float
        0 for an unstable model, infinite where no gain is too large.
    frequency : float
        At which the loop begins to oscillate there, in Hz; 0 where it runs away.
    """
    if not isinstance(model, SampledModel):
        return model.largest_stable_gain(device)
    if not model.stable:
        return 0.0, 0.0
    response = loop_response(model, device)
    gains = [(-1.0 / found, 0.0) for found in [_static_response(model, device)] if found < 0]
    for angle in (*_real_crossings(response), np.pi):  # real at π
        found = response(angle).real
        if found < 0:
            gains.append((float(-1.0 / found), float(angle / (2.0 * np.pi * model.sampling_time))))
    return min(gains, default=(float("inf"), 0.0))


def _static_response(model: SampledModel, device: DeviceSettings) -> float:
    """The loop's response at z = 1, without the pole of a free stylus's place."""
    stiffness = model.static_stiffness
    if device.hand_stiffness_N_m:
        return stiffness / device.hand_stiffness_N_m
    if stiffness:
        return float(np.copysign(np.inf, stiffness))
    # H = −H′(1)(1 − z⁻¹) by z⁻¹, and a force moves the stylus by T/b a sample in the end.
    slope = np.arange(len(model.numerator)) @ model.numerator / model.denominator.sum()
    return float(-slope * model.sampling_time / (device.damping_N_s_m + device.hand_damping_N_s_m))


def _real_crossings(response: Callable[[np.ndarray], np.ndarray]) -> list[float]:
    """Angles at which a loop's response crosses the real axis, two close together included."""

    def imaginary(angle: float) -> float:
        return response(angle).imag

    angles = all_angles(smallest=_SLOWEST)
    values = response(angles).imag
    size, positive = np.abs(values), np.signbit(values)
    dips = (size[1:-1] < size[:-2]) & (size[1:-1] < size[2:])
    dips &= (positive[1:-1] == positive[:-2]) & (positive[1:-1] == positive[2:])
    between = []
    for index in np.flatnonzero(dips) + 1:
        sign = np.sign(values[index])
        lowest = scipy.optimize.minimize_scalar(
            lambda angle, sign: sign * imaginary(angle),
            args=(sign,),
            bounds=angles[[index - 1, index + 1]],
            method="bounded",
        )
        if lowest.fun < 0:
            between.append(lowest.x)
    angles = np.sort(np.r_[angles, between])
    positive = np.signbit(response(angles).imag)
    return [
        scipy.optimize.brentq(imaginary, angles[i], angles[i + 1], xtol=1e-15)
        for i in np.flatnonzero(positive[1:] != positive[:-1])
    ]
