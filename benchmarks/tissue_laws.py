"""Tissue tests with laws that are in no catalogue, simulated at 2 kHz and recorded at 100 Hz; nothing here is the library's.

A Kelvin–Boltzmann tissue (spring and parallel Maxwell branch) and one more law, each written as its mechanism, with its own
states that are advanced step by step.
"""

from __future__ import annotations

import math

import numpy as np

FINE, RATE = 2000, 100
"""Hz: of the simulation, of the records."""
STEP = 1 / FINE
SPRING, BRANCH, TAU = 0.5, 0.8, 0.15
"""N/mm, N/mm, s."""
AMPLITUDE = 5.0
"""mm."""


class Thixotropy:
    """A structure that motion breaks and rest rebuilds carries a spring and a damper (Barnes, 1997)."""

    def __init__(self):
        self.broken = 0.0

    def force(self, t, z, v):
        self.broken += STEP * (abs(v) / 15 * (1 - self.broken) - self.broken / 0.6)
        return (1 - self.broken) * (0.6 * z + 0.01 * v)


class MullinsDamage:
    """A stiffening spring that is softer below the largest stretch so far (Ogden and Roxburgh, 1999)."""

    def __init__(self):
        self.deepest = 0.0

    def force(self, t, z, v):
        self.deepest = max(self.deepest, abs(z))
        return 0.02 * z**3 * (1 - 0.5 * math.erf((self.deepest - abs(z)) / 2))


class Consolidation:
    """Fluid pressure in a layer of eight cells that drains at one end; its permeability falls when it is pressed."""

    def __init__(self):
        self.pressure = [0.0] * 8

    def force(self, t, z, v):
        p = self.pressure
        rate = 25 * math.exp(-z / 8)
        flow = [rate * (p[i] - p[i - 1]) if i else 2 * rate * p[0] for i in range(8)]
        for i in range(8):
            leaving = flow[i] - (flow[i + 1] if i < 7 else 0.0)
            p[i] += STEP * (v - leaving)
        return 0.5 * sum(p) / 8


class Springpot:
    """Force of a fractional derivative of order 0.35, by Grünwald and Letnikov's sum over all past at 100 Hz."""

    def __init__(self):
        self.past, self.weights, self.now, self.count = [], [1.0], 0.0, 0

    def force(self, t, z, v):
        if self.count % (FINE // RATE) == 0:
            self.past.append(z - (self.past_zero if self.past else self._begin(z)))
            n = len(self.past)
            while len(self.weights) < n:
                k = len(self.weights)
                self.weights.append(self.weights[-1] * (k - 1 - 0.35) / k)
            self.now = 0.6 * RATE**0.35 * float(np.dot(self.weights[:n], self.past[::-1]))
        self.count += 1
        return self.now

    def _begin(self, z):
        self.past_zero = z
        return z


class SnapThrough:
    """A shallow truss in series with a spring: its inner joint jumps from one side to the other (von Mises, 1923)."""

    def __init__(self):
        self.joint = 0.0

    def force(self, t, z, v):
        pull = 0.5 * (z - self.joint)
        self.joint += STEP / 0.01 * (pull + 0.6 * self.joint - 0.1 * self.joint**3)
        return pull


class Puncture:
    """A membrane at 1.5 mm that is pushed in until it bursts at 3 mm and closes when the tool comes back above it."""

    def __init__(self):
        self.closed = True

    def force(self, t, z, v):
        if z < 1.5:
            self.closed = True
        elif z > 3.0:
            self.closed = False
        return 1.2 * max(z - 1.5, 0.0) if self.closed else 0.0


class GainDrift:
    """The sensor's gain follows the temperature of the room; a share of the tissue's force."""

    gain = True

    def force(self, t, z, v):
        return 0.12 * math.sin(2 * math.pi * t / 13 + 0.7)


class CrossTalk:
    """A tenth of the lateral force, whose axis moves at random and is not recorded."""

    def __init__(self):
        random = np.random.default_rng(5)
        self.lines = np.arange(1, 31) * 0.1
        self.phases = random.uniform(0, 2 * np.pi, 30)

    def force(self, t, z, v):
        if round(t * FINE) % 20 == 0:
            self.now = 0.08 * float(np.cos(2 * np.pi * self.lines * t + self.phases).sum())
        return self.now


class BackEmf:
    """A motor's current, with resistance and inductance, and an iron core that saturates."""

    def __init__(self):
        self.current = 0.0

    def force(self, t, z, v):
        self.current += STEP / 0.02 * (0.02 * v - self.current)
        return 0.9 * math.tanh(self.current)


class Cogging:
    """Magnets at 3.2 mm, with a second harmonic."""

    def force(self, t, z, v):
        return 0.4 * math.sin(2 * math.pi * z / 3.2 + 0.4) + 0.1 * math.sin(4 * math.pi * z / 3.2)


class Adhesion:
    """A bridge of fluid that forms on contact, pulls back on the way out and tears at 2 mm."""

    def __init__(self):
        self.bridge = False

    def force(self, t, z, v):
        if z > 0:
            self.bridge = True
        elif z < -2:
            self.bridge = False
        return -0.9 * (1 - math.exp(z)) if self.bridge and z < 0 else 0.0


class DepthFriction:
    """Dry friction along a needle: a little at the skin, more with the length that is inside."""

    def force(self, t, z, v):
        return (0.15 + 0.08 * max(z, 0.0)) * math.tanh(v / 0.6)


class EddyCurrent:
    """A magnetic brake: beyond a critical speed it brakes less."""

    def force(self, t, z, v):
        return 0.05 * v / (1 + (v / 35) ** 2)


class RateAndState:
    """Friction that grows with the age of the contact (Dieterich, 1979; Ruina, 1983)."""

    def __init__(self):
        self.age = 0.01

    def force(self, t, z, v):
        self.age += STEP * (1 - abs(v) * self.age / 1.0)
        return (0.3 + 0.12 * math.log(1 + self.age / 0.02)) * math.tanh(v / 0.8)


class PowerLawFluid:
    """A shear-thinning fluid: the root of the speed."""

    def force(self, t, z, v):
        return 0.09 * math.copysign(math.sqrt(abs(v)), v)


class RateStiffening:
    """A spring that stiffens while it moves fast."""

    def force(self, t, z, v):
        return 0.25 * z * abs(v) / (abs(v) + 30)


LAWS = {
    "thixotropy": Thixotropy,
    "mullins_damage": MullinsDamage,
    "poroelastic": Consolidation,
    "fractional": Springpot,
    "snap_through": SnapThrough,
    "puncture": Puncture,
    "gain_drift": GainDrift,
    "cross_talk": CrossTalk,
    "back_emf": BackEmf,
    "cogging": Cogging,
    "adhesion": Adhesion,
    "depth_friction": DepthFriction,
    "eddy_current": EddyCurrent,
    "rate_and_state": RateAndState,
    "power_law_fluid": PowerLawFluid,
    "rate_stiffening": RateStiffening,
}


def sines(duration: float, lines: np.ndarray, seed: int, size: float = AMPLITUDE, pace: float = 1.0):
    """Fine time, position and velocity of a multisine that begins at rest in zero position; `pace` makes it faster."""
    random = np.random.default_rng(seed)
    phases = random.uniform(0, 2 * np.pi, len(lines))
    weights = lines**-0.7
    time = np.arange(round(duration * FINE)) / FINE
    angle = 2 * np.pi * np.outer(time * pace, lines) + phases
    position, velocity = np.cos(angle) @ weights, -np.sin(angle) @ (weights * 2 * np.pi * lines * pace)
    scale = size / np.abs(position).max()
    return time, scale * position, scale * velocity


def swept(duration: float, size: float = AMPLITUDE):
    """Fine time, position and velocity of a chirp from 0.1 to 4 Hz."""
    time = np.arange(round(duration * FINE)) / FINE
    rate = (4 - 0.1) / duration
    angle = 2 * np.pi * (0.1 * time + rate * time**2 / 2)
    return time, size * np.sin(angle), size * np.cos(angle) * 2 * np.pi * (0.1 + rate * time)


PERIODIC = np.arange(1, 51) * 0.1
UNEVEN = np.sort(np.random.default_rng(11).uniform(0.06, 5.0, 60))


def motions() -> dict[str, tuple]:
    """Fine motions: three that a law is looked for in, three that it is tried on."""
    return {
        "multisine": sines(50, PERIODIC, 1),
        "chirp": swept(12),
        "noise": sines(12, UNEVEN, 2),
        "fresh": sines(20, UNEVEN, 3),
        "larger": sines(20, UNEVEN, 4, 1.5 * AMPLITUDE),
        "faster": sines(20, UNEVEN, 5, pace=1.5),
    }


def simulate(law, motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, position and force at 100 Hz of a tissue with a law, without noise; None for the tissue alone."""
    time, position, velocity = motion
    branch, decay = 0.0, math.exp(-STEP / TAU)
    force = np.empty(len(time))
    for k, (t, z, v) in enumerate(zip(time.tolist(), position.tolist(), velocity.tolist(), strict=True)):
        tissue = SPRING * z + BRANCH * branch
        extra = 0.0 if law is None else law.force(t, z, v)
        force[k] = tissue * (1 + extra) if getattr(law, "gain", False) else tissue + extra
        following = velocity[k + 1] if k + 1 < len(velocity) else v
        branch = branch * decay + TAU * (1 - decay) * (v + following) / 2
    keep = slice(None, None, FINE // RATE)
    return time[keep], position[keep], force[keep]
