"""Models with effects sample by sample in Python: an account of the catalogue's C code that is independent of it.

Every operation stands in the order in which the forms' C code has it, so that with the same elementary functions the
bits are the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lumbar.errors import NumericalError
from lumbar.models.form import Place

NEGLIGIBLE = 1e-200
"""Numbers below this are flushed to zero, as in ``sampled_force.c``."""


def softplus(value: float) -> float:
    """ln(1 + e^x), without overflow."""
    return max(value, 0.0) + math.log1p(math.exp(-abs(value)))


@dataclass(frozen=True)
class Functions:
    """Elementary functions."""

    expm1: Callable[[float], float] = math.expm1
    tanh: Callable[[float], float] = math.tanh
    sinh: Callable[[float], float] = math.sinh
    arctan: Callable[[float], float] = math.atan
    power: Callable[[float, float], float] = math.pow
    softplus: Callable[[float], float] = softplus
    sine: Callable[[float], float] = field(default=lambda turns: math.sin(math.tau * (turns - round(turns))))
    cosine: Callable[[float], float] = field(
        default=lambda turns: math.cos(math.tau * (turns - round(turns)))
    )

    def decay(self, value: float) -> float:
        """e^−x."""
        return 1.0 + self.expm1(-value)


@dataclass
class Motion:
    """Motion at one sample, by backward differences; at rest at its first position before."""

    time: float
    first: bool
    position: float
    step: float
    velocity: float
    acceleration: float
    path: float
    sampling_time: float


class Tracker:
    """Follows a position from sample to sample."""

    def __init__(self, sampling_time: float):
        self.sampling_time = sampling_time
        self.last: Motion | None = None

    def move(self, sample: int, position: float) -> Motion:
        """Return the motion at the next sample."""
        time = sample * self.sampling_time
        if self.last is None:
            now = Motion(time, True, position, 0.0, 0.0, 0.0, 0.0, self.sampling_time)
        else:
            step = position - self.last.position
            velocity = step / self.sampling_time
            acceleration = (velocity - self.last.velocity) / self.sampling_time
            path = self.last.path + abs(step)
            now = Motion(time, False, position, step, velocity, acceleration, path, self.sampling_time)
        self.last = Motion(
            time,
            False,
            _flushed(position),
            0.0,
            _flushed(now.velocity),
            0.0,
            _flushed(now.path),
            self.sampling_time,
        )
        return now


def _flushed(value: float) -> float:
    return 0.0 if abs(value) < NEGLIGIBLE else value


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


def _dahl(share: float, step: float, distance: float, f: Functions) -> float:
    direction = _sign(step)
    return share if not direction else direction + (share - direction) * f.decay(abs(step) / distance)


def _bouc_wen(share: float, step: float, distance: float, f: Functions) -> float:
    direction = _sign(step)
    if not direction:
        return share
    share, travel = direction * share, abs(step) / distance
    if share + travel < 0:
        return direction * (share + travel)
    if share < 0:
        share, travel = 0.0, travel + share
    added = f.tanh(travel)
    return direction * ((share + added) / (1.0 + share * added))


def _play(before: float, position: float, gap: float, first: bool) -> float:
    return min(max(position if first else before, position - gap), position + gap)


def _stribeck(p, m: Motion, f: Functions) -> float:
    sliding, ratio = f.tanh(m.velocity / p[2]), m.velocity / p[3]
    return p[0] * sliding + p[1] * (sliding * f.decay(ratio * ratio))


def _sine(p, m: Motion, f: Functions) -> float:
    turns = p[2] * m.time
    return p[0] * f.sine(turns) + p[1] * f.cosine(turns)


def _overtones(p, m: Motion, f: Functions) -> float:
    turns, force = p[14] * m.time, 0.0
    for order in range(1, 8):
        force += p[2 * order - 2] * f.sine(order * turns)
        force += p[2 * order - 1] * f.cosine(order * turns)
    return force


_STATIC = {
    "base/LE": lambda p, m, f: p[0] * m.position,
    "base/pendulum": lambda p, m, f: (
        p[0] * m.acceleration + p[1] * m.velocity + p[2] * f.sine(m.position / math.tau)
    ),
    "base/KV": lambda p, m, f: p[0] * m.position + p[1] * m.velocity,
    "hardening_stiffness/cubic": lambda p, m, f: p[0] * (m.position * m.position * m.position),
    "hardening_stiffness/exponential": lambda p, m, f: (
        p[0] * (_sign(m.position) * f.expm1(abs(m.position) / p[1]))
    ),
    "hardening_stiffness/bilinear": lambda p, m, f: (
        p[0] * (_sign(m.position) * max(abs(m.position) - p[1], 0.0))
    ),
    "hardening_stiffness/power": lambda p, m, f: p[0] * (_sign(m.position) * f.power(abs(m.position), p[1])),
    "quadratic_stiffness/quadratic": lambda p, m, f: p[0] * (m.position * m.position),
    "quadratic_stiffness/two_sided": lambda p, m, f: p[0] * abs(m.position),
    "quadratic_stiffness/rounded": lambda p, m, f: (
        p[0] * (math.sqrt(m.position * m.position + p[1] * p[1]) - p[1])
    ),
    "quadratic_stiffness/deep": lambda p, m, f: p[0] * max(m.position - p[1], 0.0),
    "quadratic_stiffness/shallow": lambda p, m, f: p[0] * min(m.position + p[1], 0.0),
    "coulomb_friction/coulomb": lambda p, m, f: p[0] * f.tanh(m.velocity / p[1]),
    "coulomb_friction/arctangent": lambda p, m, f: p[0] * (2 / math.pi * f.arctan(m.velocity / p[1])),
    "coulomb_friction/stribeck": _stribeck,
    "depth_dependent_damping/bilinear": lambda p, m, f: p[0] * (m.position * m.velocity) + p[1] * m.velocity,
    "depth_dependent_damping/one_sided": lambda p, m, f: (
        p[0] * (max(m.position, 0.0) * m.velocity) + p[1] * m.velocity
    ),
    "depth_dependent_damping/hunt_crossley": lambda p, m, f: (
        p[0] * (f.power(max(m.position, 0.0), p[2]) * m.velocity) + p[1] * m.velocity
    ),
    "quadratic_damping/quadratic": lambda p, m, f: p[0] * (m.velocity * abs(m.velocity)),
    "quadratic_damping/power": lambda p, m, f: p[0] * (_sign(m.velocity) * f.power(abs(m.velocity), p[1])),
    "quadratic_damping/sinh": lambda p, m, f: p[0] * f.sinh(m.velocity / p[1]),
    "inertia/mass": lambda p, m, f: p[0] * m.acceleration,
    "drift/linear": lambda p, m, f: p[0] * m.time,
    "drift/settling": lambda p, m, f: p[0] * -f.expm1(-m.time / p[1]),
    "drift/power": lambda p, m, f: p[0] * f.power(m.time, p[1]),
    "softening/path": lambda p, m, f: p[0] * (-m.position * f.expm1(-m.path / p[1])),
    "softening/time": lambda p, m, f: p[0] * (-m.position * f.expm1(-m.time / p[1])),
    "softening/path_to_floor": lambda p, m, f: p[0] * (m.position * min(m.path / p[1], 1.0)),
    "periodic_disturbance/sine": _sine,
    "periodic_disturbance/overtones": _overtones,
}
"""Parallel forms without memory: from parameters and motion to force."""


def _relaxed(elongation: float, relaxation_time: float, m: Motion) -> float:
    """Ramp-invariant: the pole is e^(−T/τ), the gain (1 − e^(−T/τ)) τ/T."""
    ratio = m.sampling_time / relaxation_time
    return math.exp(-ratio) * elongation + -math.expm1(-ratio) / ratio * m.step


def _relax(elongation: float, p, m: Motion, f: Functions) -> tuple[float, float]:
    elongation = _relaxed(elongation, p[1], m)
    return elongation, p[0] * elongation


def _relax_beside_spring(elongation: float, p, m: Motion, f: Functions) -> tuple[float, float]:
    elongation = _relaxed(elongation, p[2], m)
    return elongation, p[0] * m.position + p[1] * elongation


def _friction(rule):
    def step(share: float, p, m: Motion, f: Functions) -> tuple[float, float]:
        share = rule(share, m.step, p[1], f)
        return share, p[0] * share

    return step


def _elastoplastic(slider: float, p, m: Motion, f: Functions) -> tuple[float, float]:
    slider = _play(slider, m.position, p[1], m.first)
    return slider, p[0] * ((m.position - slider) / p[1])


def _iwan(sliders, p, m: Motion, f: Functions) -> tuple[tuple, float]:
    distances = [p[4] / 2**order for order in range(4)]
    before = sliders if isinstance(sliders, tuple) else (sliders,) * 4
    sliders = tuple(
        _play(slider, m.position, distance, m.first)
        for slider, distance in zip(before, distances, strict=True)
    )
    force = 0.0
    for limit, slider, distance in zip(p, sliders, distances, strict=False):
        force += limit * ((m.position - slider) / distance)
    return sliders, force


_REMEMBERING = {
    "base/Maxwell": _relax,
    "base/KB": _relax_beside_spring,
    "second_relaxation/maxwell_branch": _relax,
    "hysteresis/dahl": _friction(_dahl),
    "hysteresis/bouc_wen": _friction(_bouc_wen),
    "hysteresis/elastoplastic": _elastoplastic,
    "hysteresis/iwan": _iwan,
}
"""Parallel forms with one number of memory: from it, parameters and motion to the next one and the force."""


def _delayed(past: list[float], samples: float, position: float, first: bool) -> float:
    """Position some samples ago, linear in between; `past` holds the positions before, newest first."""
    whole = math.floor(samples)
    if first:
        past[:] = [_flushed(position)] * (whole + 1)
        return position
    newer, older = (position if whole == 0 else past[whole - 1]), past[whole]
    past[:] = [_flushed(position), *past[:-1]]
    return newer + (samples - whole) * (older - newer)


def _at_most_one(ratio: float) -> float:
    return 1.0 / ratio if ratio > 1 else ratio


_OUTPUT = {
    "contact_loss/sharp": lambda p, m, f, force: max(force, -p[0]),
    "contact_loss/soft": lambda p, m, f, force: p[1] * f.softplus((force + p[0]) / p[1]) - p[0],
    "saturation/sharp": lambda p, m, f, force: min(max(force, -p[0]), p[0]),
    "saturation/rounded": lambda p, m, f, force: (
        min(max(force, -p[0]), p[0])
        / f.power(1.0 + f.power(_at_most_one(abs(force / p[0])), p[1]), 1.0 / p[1])
    ),
    "saturation/soft": lambda p, m, f, force: p[0] * f.tanh(force / p[0]),
    "softening/whole_force": lambda p, m, f, force: force * (1.0 + p[0] * f.expm1(-m.path / p[1])),
}


def _parameters(term) -> tuple[float, ...]:
    return (*term.linear, *term.nonlinear)


class Simulation:
    """A model with effects and what it remembers between samples."""

    def __init__(self, model, functions: Functions):
        self.terms, self.sampling_time = model.terms, model.sampling_time
        self.functions = functions
        self.samples = 0
        self.tool, self.tissue = Tracker(model.sampling_time), Tracker(model.sampling_time)
        self.memory = [0.0] * len(model.terms)
        self.past: list[list[float]] = [[] for _ in model.terms]

    def take(self, position: float) -> float:
        """Return the force at the next sample."""
        tool = self.tool.move(self.samples, position)
        for index, term in self._at(Place.INPUT):
            position = self._reaching_tissue(index, term, position, tool.first)
        tissue = self.tissue.move(self.samples, position)
        force = 0.0
        for index, term in self._at(Place.PARALLEL):
            force += self._added(index, term, tissue)
        for _, term in self._at(Place.OUTPUT):
            force = _OUTPUT[term.form.key](_parameters(term), tool, self.functions, force)
        self.samples += 1
        return force

    def _at(self, place: Place):
        return [(index, term) for index, term in enumerate(self.terms) if term.form.place is place]

    def _reaching_tissue(self, index: int, term, position: float, first: bool) -> float:
        if term.form.key == "delay/pure":
            return _delayed(self.past[index], _parameters(term)[0] / self.sampling_time, position, first)
        position = _play(self.memory[index], position, _parameters(term)[0], first)
        self.memory[index] = _flushed(position)
        return position

    def _added(self, index: int, term, tissue: Motion) -> float:
        key, parameters = term.form.key, _parameters(term)
        if key in _STATIC:
            return _STATIC[key](parameters, tissue, self.functions)
        kept, force = _REMEMBERING[key](self.memory[index], parameters, tissue, self.functions)
        self.memory[index] = tuple(map(_flushed, kept)) if isinstance(kept, tuple) else _flushed(kept)
        return force


def simulate(model, positions: Sequence[float], functions: Functions | None = None) -> np.ndarray:
    """Simulate a model with effects sample by sample.

    Parameters
    ----------
    model : lumbar.fmu.build.effect_model.EffectModel
    positions : array_like, shape (samples,)
        Deviations from rest.
    functions : Functions, optional
        Elementary functions; default Python's.

    Returns
    -------
    numpy.ndarray, shape (samples,)
        Force as a deviation from rest.

    Raises
    ------
    NumericalError
        If a force overflows.
    """
    simulation = Simulation(model, functions or Functions())
    try:
        forces = np.array([simulation.take(float(position)) for position in positions])
    except OverflowError as error:
        raise NumericalError(f"{model.base.name} with effects: the force overflows ({error})") from error
    if not np.isfinite(forces).all():
        raise NumericalError(f"{model.base.name} with effects: the force overflows")
    return forces
