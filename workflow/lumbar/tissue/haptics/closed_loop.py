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

_BLOCK = 64
"""Number of coefficients in a block of a long polynomial."""
_ROUNDING = 1e-9
"""A numerator's sum counts as 0 below this share of its coefficients' magnitudes."""


def all_angles(points: int = 2000, smallest: float = 1e-4) -> np.ndarray:
    """Return angles ωT from near 0 to π: evenly spaced ones, and denser ones towards 0 for slow relaxations."""
    slow = np.geomspace(smallest, np.pi / points, points // 4)
    return np.concatenate([slow[:-1], np.linspace(slow[-1], np.pi, points)])


def evaluate_polynomials(coefficients: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the values of polynomials in z⁻¹ at exp(jθ), complex, shape (angles,) or (angles, polynomials).

    `coefficients` belong to z⁰, z⁻¹, …, shape (powers,) or (powers, polynomials). `angles` are θ, shape (angles,); for a single
    polynomial any shape.
    """
    if coefficients.ndim == 1:
        # After a delay, and in a model that runs several times over, most powers have no coefficient.
        powers = np.flatnonzero(coefficients)
        if 4 * len(powers) < len(coefficients):
            return np.exp(-1j * np.multiply.outer(angles, powers)) @ coefficients[powers]
        if len(coefficients) <= _BLOCK:
            return np.polyval(coefficients[::-1], np.exp(-1j * np.asarray(angles)))
    # Horner's rule takes a Python step per coefficient. Instead sum blocks of coefficients, then the blocks.
    blocks = np.pad(coefficients.T, (*[(0, 0)] * (coefficients.ndim - 1), (0, -len(coefficients) % _BLOCK)))
    blocks = blocks.reshape(*blocks.shape[:-1], -1, _BLOCK)
    within = np.exp(-1j * np.multiply.outer(angles, np.arange(_BLOCK)))
    between = np.exp(-1j * np.multiply.outer(angles, _BLOCK * np.arange(blocks.shape[-2])))
    sums = ((within.real @ blocks.mT + 1j * (within.imag @ blocks.mT)) * between).sum(-1)
    return np.moveaxis(sums, 0, -1) if coefficients.ndim > 1 else sums


@dataclass(frozen=True)
class StableGain:
    """Largest stable gain of a loop, and the oscillation that begins there."""

    gain: float
    """Largest factor on the model's force below which the loop is stable for every factor from 0; 0 for an unstable model,
    infinite if no gain is too large."""
    frequency: float
    """Frequency in Hz of the oscillation that begins at this gain; 0 if the loop drifts away without oscillation."""
    direction: np.ndarray | None = None
    """Direction of this oscillation in space, a unit vector; None along one axis."""


@dataclass(frozen=True)
class SampledModel:
    """H(z) from sampled positions to the force that pushes back, held for one sampling time."""

    name: str
    numerator: np.ndarray
    denominator: np.ndarray
    """Coefficients of z⁰, z⁻¹, …. The numerator is in N/m, positive if the force is against the motion. Moving average and
    delays of whole samples are included."""
    sampling_time: float
    """Seconds between two samples."""
    delay: float = 0.0
    """Seconds from a sample to its force, less than `sampling_time`."""

    def response(self, angles: np.ndarray) -> np.ndarray:
        """Return H(exp(jθ)) at angles θ = ωT in radians, without `delay`; complex, shape of `angles`."""
        return evaluate_polynomials(self.numerator, angles) / evaluate_polynomials(self.denominator, angles)

    @property
    def poles(self) -> np.ndarray:
        """Roots of the denominator in z, without roots at 0."""
        # A model with several phases has powers of z⁻ᵖ only: roots in zᵖ are exact.
        phases = max(int(np.gcd.reduce(np.flatnonzero(self.denominator))), 1)
        roots = np.roots(np.trim_zeros(self.denominator[::phases], "b")).astype(complex)
        turns = np.exp(2j * np.pi * np.arange(phases) / phases)
        return np.multiply.outer(roots ** (1.0 / phases), turns).ravel()

    @property
    def stable(self) -> bool:
        """True if all poles are inside the unit circle."""
        return bool((np.abs(self.poles) < 1.0).all())

    @property
    def static_stiffness(self) -> float:
        """Static stiffness H(1) in N/m; negative if the force assists the displacement."""
        total, rounding = self.numerator.sum(), _ROUNDING * np.abs(self.numerator).sum()
        return 0.0 if abs(total) < rounding else total / self.denominator.sum()

    def late(self, seconds: float) -> Self:
        """Return the model with its force delayed by this time."""
        whole, part = divmod(self.delay + seconds, self.sampling_time)
        if self.sampling_time - part < 1e-9 * self.sampling_time:
            whole, part = whole + 1, 0.0
        part = part if part > 1e-9 * self.sampling_time else 0.0
        return replace(self, numerator=np.concatenate([np.zeros(int(whole)), self.numerator]), delay=part)


def propagation(device: DeviceSettings, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact motion of device and hand over a time in which all forces are constant.

    m ẍ + b ẋ + k x = f, with mass and damping of stylus and hand and the stiffness of the hand.

    Returns
    -------
    transition : numpy.ndarray, shape (2, 2)
        Transition matrix of position in m and velocity in m/s.
    by_force : numpy.ndarray, shape (2,)
        Change of position in m and velocity in m/s by a force of one newton.
    """
    mass = device.mass_kg + device.hand_mass_kg
    damping = device.damping_N_s_m + device.hand_damping_N_s_m
    rates = np.zeros((3, 3))
    rates[0, 1], rates[1] = 1.0, (-device.hand_stiffness_N_m / mass, -damping / mass, 1.0 / mass)
    exact = scipy.linalg.expm(rates * seconds)
    return exact[:2, :2], exact[:2, 2]


def loop_response(model: SampledModel, device: DeviceSettings) -> Callable[[np.ndarray], np.ndarray]:
    """Return the open-loop frequency response: the model times the sampled response of device and hand to its held force.

    The function maps angles ωT in radians to complex numbers; at −1 the closed loop has a pole at exp(jωT).
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


def largest_stable_gain(model: SampledModel, device: DeviceSettings) -> StableGain:
    """Return the largest stable gain of a loop; `PeriodicModel` and `SpatialLoop` have a method for it.

    If the loop's frequency response crosses the negative real axis at −r, a factor 1/r puts a pole on the unit circle. Device
    with hand and the model are stable separately, so that the smallest of these factors is the limit. The response is real at z
    = −1, at z = 1 (a negative static stiffness overcomes the hand), and at crossings in between.

    A stylus without a hand stays at any position, which is not an instability: if the model has no static stiffness, the pole z
    = 1 of this position is ignored; with a negative static stiffness no factor is stable.
    """
    if not isinstance(model, SampledModel):
        return model.largest_stable_gain(device)
    if not model.stable:
        return StableGain(0.0, 0.0)
    response, gains = loop_response(model, device), []
    # The response at z = 1, without the pole of a free stylus's position.
    stiffness = model.static_stiffness
    if device.hand_stiffness_N_m:
        static = stiffness / device.hand_stiffness_N_m
    elif stiffness:
        static = float(np.copysign(np.inf, stiffness))
    else:  # H = −H′(1)(1 − z⁻¹) by z⁻¹, and a force moves the stylus by T/b a sample in the end
        slope = np.arange(len(model.numerator)) @ model.numerator / model.denominator.sum()
        static = float(-slope * model.sampling_time / (device.damping_N_s_m + device.hand_damping_N_s_m))
    if static < 0:
        gains.append(StableGain(-1.0 / static, 0.0))
    for angle in (*_most_negative_crossing(response), np.pi):
        if (value := response(angle).real) < 0:
            gains.append(StableGain(float(-1.0 / value), float(angle / (2.0 * np.pi * model.sampling_time))))
    return min(gains, key=lambda item: (item.gain, item.frequency), default=StableGain(float("inf"), 0.0))


def _most_negative_crossing(response: Callable[[np.ndarray], np.ndarray]) -> list[float]:
    """Return the angle below π at which a loop's response crosses the negative real axis farthest from 0, if there is one."""

    def imaginary(angle: float) -> float:
        return response(angle).imag

    angles = all_angles(smallest=1e-6)
    values = response(angles)
    # Between two angles of one sign the imaginary part may dip below 0 and return: search every local minimum of its size.
    size, positive = np.abs(values.imag), np.signbit(values.imag)
    dips = (size[1:-1] < size[:-2]) & (size[1:-1] < size[2:])
    dips &= (positive[1:-1] == positive[:-2]) & (positive[1:-1] == positive[2:])
    between = []
    for index in np.flatnonzero(dips) + 1:
        lowest = scipy.optimize.minimize_scalar(
            lambda angle, sign: sign * imaginary(angle),
            args=(np.sign(values[index].imag),),
            bounds=angles[[index - 1, index + 1]],
            method="bounded",
        )
        if lowest.fun < 0:
            between.append(lowest.x)
    if between:
        angles = np.sort(np.r_[angles, between])
        values = response(angles)
    # Every change of sign brackets a crossing. Refine those first that are farthest out, until no other one can be farther.
    brackets = np.flatnonzero(np.diff(np.signbit(values.imag)))
    farthest = np.minimum(values.real[brackets], values.real[brackets + 1])
    farthest -= 2.0 * np.abs(values[brackets + 1] - values[brackets])
    crossing, least = [], 0.0
    for i, bound in sorted(zip(brackets, farthest, strict=True), key=lambda item: item[1]):
        if bound >= least:
            break
        angle = scipy.optimize.brentq(imaginary, angles[i], angles[i + 1], xtol=1e-15)
        if (value := response(angle).real) < least:
            crossing, least = [angle], value
    return crossing
