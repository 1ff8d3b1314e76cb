"""The loop of a model of several axes on a device with equal properties in every direction: a loop of matrices.

Along one axis a device is passive with a held force f = F(exp(jθ)) u over the displacement u of a sample if F + Fᴴ + 2b/T ≥ 0 for
every θ (`lumbar.tissue.haptics.ticks`). In space F is a matrix, and the least eigenvalue of its Hermitian part gives the
damping b that is needed, in the direction of its eigenvector. The loop has a pole at exp(jθ) if an eigenvalue of H(exp(jθ)) P,
with P the response of device and hand, is −1: each eigenvalue describes a curve like the response of a loop of one axis, and the
first crossing of the negative real axis ends the stable gains. If a tissue's matrices share their axes, the eigenvectors are its
principal axes.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import (
    SampledModel,
    StableGain,
    all_angles,
    evaluate_polynomials,
    loop_response,
)
from lumbar.tissue.haptics.ticks import force_by_moves

_ROUNDING = 1e-9
_IMPULSE_SAMPLES = 1 << 15
"""Number of samples in which an impulse decays in a stable loop."""
_FINE_ANGLES = 64
"""Number of angles between two neighbours of the coarse grid, if an eigenvalue may cross the real axis there."""


@dataclass(frozen=True)
class SpatialLoop:
    """H(z) of a model, or of one of its linearisations, at the servo's ticks: a matrix in N/m."""

    name: str
    impulse: np.ndarray
    """Shape (samples, axes, axes): force along each axis after a position of 1 m for a sample along each."""
    unit: SampledModel
    """A spring of 1 N/m with the clock and delay of the model."""

    def response(self, angles: np.ndarray) -> np.ndarray:
        """Return H(exp(jθ)) without the delay; shape (angles, axes, axes)."""
        size = self.impulse.shape[1:]
        return evaluate_polynomials(self.impulse.reshape(len(self.impulse), -1), angles).reshape(-1, *size)

    @property
    def static(self) -> np.ndarray:
        """Static stiffness: the symmetric part of H(1), which stores energy at a constant position."""
        total = self.impulse.sum(axis=0)
        total[np.abs(total) < _ROUNDING * np.abs(self.impulse).sum(axis=0).max()] = 0.0
        return (total + total.T) / 2.0

    def required_damping(self) -> tuple[float, np.ndarray]:
        """Return the smallest damping in N·s/m for a passive device in any passive hand, and the direction that needs it.

        Infinite with a negative static stiffness.
        """
        stiffness, directions = np.linalg.eigh(self.static)
        if stiffness[0] < -_ROUNDING * np.abs(stiffness).max(initial=0.0):
            return float("inf"), directions[:, 0]
        angles = all_angles()
        worst = int(self._damping_at(angles)[0].argmax())
        near = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], 101)
        needed, vectors = self._damping_at(near)
        at = int(needed.argmax())
        return max(0.0, float(needed[at])), _real(vectors[at])

    def _damping_at(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the required damping at every angle, and the direction that requires it, shape (angles, axes)."""
        moves, seconds = force_by_moves(self.unit, angles)
        axes = self.impulse.shape[1]
        matrix = np.einsum("apq,aij->apiqj", moves, self.response(angles))
        matrix = matrix.reshape(len(angles), -1, len(seconds) * axes)
        pieces = np.repeat(seconds, axes)
        values, vectors = np.linalg.eigh(
            np.sqrt(np.outer(pieces, pieces)) * (matrix + matrix.conj().swapaxes(1, 2))
        )
        return -values[:, 0] / 2.0, vectors[:, :axes, 0]

    def largest_stable_gain(self, device: DeviceSettings) -> StableGain:
        """Return the smallest of all eigenvalues' largest stable gains; see `lumbar.tissue.haptics.closed_loop`."""
        plant = loop_response(self.unit, device)
        # At z = 1 the loop runs away along an axis of its static stiffness.
        stiffness, directions = np.linalg.eigh(self.static)
        if device.hand_stiffness_N_m:
            static = stiffness / device.hand_stiffness_N_m
        else:
            # A free stylus stays at any position: without static stiffness its lag decides, like along one axis.
            damping = device.damping_N_s_m + device.hand_damping_N_s_m
            lags = np.einsum("s,sij->ij", np.arange(len(self.impulse)), self.impulse)
            lag = -np.einsum("ik,ij,jk->k", directions, lags, directions) * self.unit.sampling_time / damping
            is_stiff = np.abs(stiffness) > _ROUNDING * np.abs(stiffness).max(initial=0.0)
            static = np.where(is_stiff, np.copysign(np.inf, stiffness), lag)
        gains = [(-1.0 / value, 0.0) for value in static if value < 0]

        def eigenvalues(angles: np.ndarray) -> np.ndarray:
            return _track_eigenvalues(np.linalg.eigvals(self.response(angles) * plant(angles)[:, None, None]))

        # Coarse angles show near which of them an eigenvalue may cross the negative real axis.
        angles = all_angles(smallest=1e-6)
        values = eigenvalues(angles)
        moved = np.abs(np.diff(values, axis=0))
        near = np.minimum(np.abs(values[1:].imag), np.abs(values[:-1].imag)) <= 2.0 * moved
        near &= np.minimum(values[1:].real, values[:-1].real) < moved
        rows = np.flatnonzero(near.any(axis=1))
        # Finer angles bracket the crossings, which are interpolated.
        finer = np.linspace(angles[rows], angles[rows + 1], _FINE_ANGLES + 1, axis=1)
        curves = eigenvalues(finer.ravel()).reshape(*finer.shape, -1)
        for fine, curve in zip(finer, map(_track_eigenvalues, curves), strict=True):
            for row, column in zip(*np.nonzero(np.diff(np.signbit(curve.imag), axis=0)), strict=True):
                before, after = curve[row : row + 2, column]
                share = before.imag / (before.imag - after.imag)
                real = before.real + share * (after.real - before.real)
                if real < 0:
                    gains.append((-1.0 / real, fine[row] + share * (fine[row + 1] - fine[row])))
        # At π the response is real.
        gains += [(-1.0 / value.real, np.pi) for value in eigenvalues(np.array([np.pi]))[0] if value.real < 0]
        if not gains:
            return StableGain(float("inf"), 0.0, directions[:, -1])
        gain, angle = min(gains, key=lambda item: item[0])
        if angle == 0:
            return StableGain(float(gain), 0.0, directions[:, 0])
        (response,) = self.response(np.array([angle]))
        values, vectors = np.linalg.eig(response * plant(np.array([angle])))
        direction = _real(vectors[:, np.abs(values + 1.0 / gain).argmin()])
        return StableGain(float(gain), float(angle / (2.0 * np.pi * self.unit.sampling_time)), direction)

    def encoder_ripple(self, device: DeviceSettings) -> float:
        """Return the peak to peak force along an axis that the encoder's steps can sustain in a stable loop, in N.

        A bounded error gives at most its size times the 1-norm of its impulse responses, H (1 + P H)⁻¹, as in
        `lumbar.tissue.haptics.simulation.encoder_ripple`.
        """
        angles = np.linspace(0.0, np.pi, _IMPULSE_SAMPLES // 2 + 1)
        plant = loop_response(self.unit, device)(angles)[:, None, None]
        model = np.fft.rfft(self.impulse, _IMPULSE_SAMPLES, axis=0)
        closed = model @ np.linalg.inv(np.eye(model.shape[1]) + plant * model)
        size = np.abs(np.fft.irfft(closed, _IMPULSE_SAMPLES, axis=0)).sum(axis=(0, 2)).max()
        return float(size * device.encoder_um * 1e-6)

    def one_step(self, device: DeviceSettings) -> float:
        """Return the largest force along an axis, in N, in response to sines of one encoder step along every axis."""
        return float(np.abs(self.response(all_angles())).sum(axis=2).max() * device.encoder_um * 1e-6)


def _track_eigenvalues(values: np.ndarray) -> np.ndarray:
    """Sort the eigenvalues at each angle: each goes to the column of the nearest eigenvalue at the previous angle."""
    orders = np.array(list(permutations(range(values.shape[1]))))
    tracked = values.copy()
    for row in range(1, len(tracked)):
        nearest = np.abs(tracked[row][orders] - tracked[row - 1]).sum(axis=1).argmin()
        tracked[row] = tracked[row][orders[nearest]]
    return tracked


def _real(vector: np.ndarray) -> np.ndarray:
    """Return the real direction of a complex eigenvector, without its arbitrary phase."""
    direction = (vector * vector[np.abs(vector).argmax()].conj()).real
    return direction / np.linalg.norm(direction)


def direction_text(axes: tuple[str, ...], direction: np.ndarray) -> str:
    """Return a unit vector as text with the names of its axes; its largest component is positive."""
    signed = direction * (1.0 if direction[np.abs(direction).argmax()] > 0 else -1.0)
    return f"{', '.join(axes)} = ({', '.join(f'{value + 0.0:.2g}' for value in np.round(signed, 3))})"
