"""Proof that a loop is stable whatever its ticks do, as long as no gap between them is too long: a small-gain theorem.

The loop is held against an even one: the model reads the position at the very instant of each sample, and every force is shown
after the same delay. What ticks at other times change is bounded by what goes round that loop.

- The step u that a sample adds to the force comes by a time δ, of at most D, later or earlier. Seen from afterwards, a newton
  for δ is a jump of position and velocity by γ(δ) at once; seen from within, the position is off by max |γ₁| at most.
- A position on a straight line across a gap g is off by the acceleration, weighted with Green's function of the gap, whose
  integral is g²/8 at most. For an instant that is almost reached it is that of the tick.

The loop is stable if the matrix N of these norms times the largest gains of the even loop has a spectral radius below 1: on the
way from the even loop to it, with changes that grow from nothing, the equations stay solvable in ℓ².

C. A. Desoer and M. Vidyasagar, Feedback Systems: Input-Output Properties (1975), chapter III; for delays that vary C.-Y. Kao and
B. Lincoln, Simple stability criteria for systems with time-varying delays, Automatica 40 (2004) 1429–1434.
"""

import numpy as np
import scipy

from lumbar.settings.runtime import DeviceSettings
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, angles_near, propagation
from lumbar.tissue.haptics.ticks.sequence import REACHED, PeriodicModel

_POINTS = 400
"""Angles, beside those near a pole."""
_LARGEST, _FACTORS, _HALVINGS, _PARTS = 1e4, np.linspace(0.04, 1.0, 25), 8, 64


def proved_gain(model: SampledModel, device: DeviceSettings, late: float, gap: float) -> float:
    """Return a factor on the model's force up to which the loop is proved to be stable for all ticks there may be, or 0.

    Parameters
    ----------
    model : SampledModel
        At the FMU's own samples, without delay.
    late : float
        Longest time in seconds from the instant of a sample to the tick that takes it.
    gap : float
        Longest time from tick to tick.
    """
    even = PeriodicModel(model, (model.sampling_time,), delay=1e-3 * device.delay_ms + late / 2.0)
    changes = _Changes(even, device, late / 2.0 + REACHED * model.sampling_time, gap)
    factors = min(even.largest_stable_gain(device)[0], _LARGEST) * _FACTORS
    proved = next((index for index, factor in enumerate(factors) if not changes.small(factor)), len(factors))
    low, high = (0.0, *factors, factors[-1])[proved : proved + 2]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if changes.small(middle) else (low, middle)
    return float(low)


class _Changes:
    """What ticks change in an even loop, by norms; with a letter of the module's description where it has one."""

    def __init__(self, even: PeriodicModel, device: DeviceSettings, off: float, gap: float):
        """`off` is D, `gap` g."""
        self.even, self.device, step = even, device, even.sampling_time
        self.whole = int(even.delay // step)
        self.mass = device.mass_kg + device.hand_mass_kg
        self.damping = device.damping_N_s_m + device.hand_damping_N_s_m
        moves = []
        for time in np.linspace(0.0, off, _PARTS + 1):
            transition, by_force = propagation(device, time)
            moves += [by_force, np.linalg.solve(transition, by_force)]
        self.jumps = np.abs(moves).max(axis=0)  # max |γ|
        together = np.floor(2.0 * off / step) + 1.0  # steps that are under way at once
        self.read = together * self.jumps[0]
        # Both errors of a reading together, ‖ε‖ ≤ bent ‖(a, share · v)‖: of the one each has √2 times its own.
        self.bent = np.sqrt(2.0 * (1.0 + 2.0 * step / gap) / step) * gap**2 / 8.0
        self.share = np.sqrt(2.0 * REACHED * step) / self.bent
        acceleration = (
            device.hand_stiffness_N_m * self.jumps[0] + self.damping * self.jumps[1] + 1.0
        ) / self.mass
        self.within = np.sqrt(together * off) * (acceleration + self.share * self.jumps[1])
        self.onward, self.energy = self._period()

    def _period(self) -> tuple[np.ndarray, np.ndarray]:
        """Of a period from position, velocity, the force before, the new one, and jumps of both at which it begins to act.

        Returns
        -------
        onward : numpy.ndarray, shape (2, 6)
            Position and velocity after it.
        energy : numpy.ndarray, shape (6, 6)
            The integral of a² + (share · v)² over it.
        """
        first = self.even.delay - self.whole * self.even.sampling_time
        state, energy = np.eye(4, 6), np.zeros((6, 6))
        for force, seconds in ((2, first), (3, self.even.sampling_time - first)):
            motion, seen = np.zeros((4, 4)), np.zeros((2, 4))
            motion[0, 1] = 1.0
            motion[1, [0, 1, force]] = (
                -np.array([self.device.hand_stiffness_N_m, self.damping, 1.0]) / self.mass
            )
            seen[0], seen[1, 1] = motion[1], self.share
            # C. F. Van Loan, IEEE Transactions on Automatic Control 23 (1978) 395–404.
            grown = scipy.linalg.expm(
                np.block([[-motion.T, seen.T @ seen], [np.zeros((4, 4)), motion]]) * seconds
            )
            after = grown[4:, 4:]
            energy += state.T @ after.T @ grown[:4, 4:] @ state
            state = after @ state
            if force == 2:
                state[:2, 4:] += np.eye(2)
        return state[:2], energy

    def small(self, gain: float) -> bool:
        """Whether the theorem holds at a gain."""
        poles = np.linalg.eigvals(self.even.monodromy(self.device, gain))
        if np.abs(poles).max() >= 1.0:
            return False
        angles = np.concatenate([all_angles(_POINTS), angles_near(poles)])
        sizes = np.array([*self.jumps, self.read + self.bent * self.within])
        gains = self._gains(gain, angles)
        norms = np.stack([gains @ sizes, gains[:, 2] * self.bent], axis=1)
        return bool(np.abs(np.linalg.eigvals(norms)).max() < 1.0)

    def _gains(self, gain: float, angles: np.ndarray) -> np.ndarray:
        """Largest gains from jumps of position and velocity and from errors of a reading to u and to (a, share · v); (2, 3)."""
        ahead, response = np.exp(1j * angles)[:, None], gain * self.even.model.response(angles)[:, None]
        new = ahead**-self.whole
        shown = new * self.onward[:, 3] + new / ahead * self.onward[:, 2]
        loop = ahead[:, :, None] * np.eye(2) - self.onward[:, :2]
        loop[:, :, 0] -= shown * response
        driven = np.stack([new * self.onward[:, 4], new * self.onward[:, 5], shown * response], axis=2)
        states = np.linalg.solve(loop, driven)
        forces = response * (states[:, 0] + [0.0, 0.0, 1.0])
        period = np.zeros((len(angles), 6, 3), complex)
        period[:, :2], period[:, 2], period[:, 3] = states, new / ahead * forces, new * forces
        period[:, 4, :1] = period[:, 5, 1:2] = new
        seen = np.einsum("nis,ij,njs->ns", period.conj(), self.energy, period).real
        return np.array([np.abs((1.0 - 1.0 / ahead) * forces).max(axis=0), np.sqrt(seen.max(axis=0))])
