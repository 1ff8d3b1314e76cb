"""Poles of a linear time-invariant model from position to force, and the forces of its linear parameters."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from lumbar.base.formats import plural
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.effects.catalogue import read_model_bases
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.operators import relaxation
from lumbar.tissue.models.state_equation import MOST_STATES
from lumbar.tissue.models.transfer_function import filtered

_STEP = 1e-5
"""Relative step of finite differences with respect to poles and delay."""
_MIN_DISTANCE = 1e-3
"""Smallest relative distance of two poles of a pair: at smaller distances the difference of their responses is rounding."""
_ITERATIONS = 6
_START_DAMPING = 0.3
"""Damping ratio of the starting pairs of poles."""


@dataclass(frozen=True, eq=False)
class Poles:
    """Poles of a strictly stable model, in the left half-plane by construction."""

    rates: np.ndarray
    """Rates (1/s) of relaxing (Maxwell) branches, shape (branches,): real poles at −rate, time constants 1/rate."""
    sections: np.ndarray
    """Pairs of poles, shape (sections, 2): roots of s² + a₁ s + a₀ with a₁ (1/s) and a₀ (1/s²) positive."""
    delay: float = 0.0
    """Delay of the force after the position in seconds."""
    direct: int = 4
    """Number of direct terms, in this order: the constant, the position and its two derivatives."""

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.rates) + 2 * len(self.sections)

    @classmethod
    def from_places(cls, places: np.ndarray) -> Self:
        """Return poles at these places (1/s), with unstable poles reflected into the left half-plane."""
        places = np.asarray(places, dtype=complex)
        size = np.abs(places)
        pairs = places[places.imag > 1e-6 * size]
        real = np.abs(places[np.abs(places.imag) <= 1e-6 * size].real)
        real = np.sort(np.maximum(real, 1e-12 * size.max(initial=0.0)))
        damped = np.maximum(np.abs(pairs.real), 1e-6 * np.abs(pairs))
        sections = [(2 * alpha, alpha**2 + pole.imag**2) for alpha, pole in zip(damped, pairs, strict=True)]
        sections += [(slow + fast, slow * fast) for slow, fast in zip(real[0:-1:2], real[1::2], strict=True)]
        return cls(real[len(real) - len(real) % 2 :], np.array(sections).reshape(-1, 2))

    @property
    def logarithms(self) -> np.ndarray:
        """Logarithms of the searched parameters: delay if it is not 0, sections, rates."""
        return np.log([*[self.delay] * bool(self.delay), *self.sections.ravel(), *self.rates])

    def moved_to(self, vector: np.ndarray) -> Self:
        """Return poles of the same kind with other `logarithms`."""
        values, first = np.exp(vector), int(self.delay > 0)
        paired = first + self.sections.size
        sections = values[first:paired].reshape(-1, 2)
        return type(self)(values[paired:], sections, float(values[0]) if first else 0.0, self.direct)


def forces(motion: Motion | JoinedMotions, poles: Poles, held: bool) -> np.ndarray:
    """Return the forces of the linear parameters at size 1, all from rest at the first position, shape (samples, parameters).

    The columns belong to a constant, the position and its derivatives, the sections (two columns each) and the branches (one
    column each). If the input is a zero-order hold (`held`), its present and last value replace the derivatives. With a delay
    there is no column of the acceleration, because a small delay has nearly the same effect.
    """
    if isinstance(motion, JoinedMotions):
        return np.concatenate([forces(part, poles, held) for part in motion.parts])
    motion = _delayed(motion, poles.delay)
    one, position = np.ones(len(motion)), motion.position
    if held:
        direct = [one, position, np.append(position[:1], position[:-1])]
    else:
        direct = [one, position, motion.velocity, *([] if poles.delay else [motion.acceleration])]
    sections = [column for section in poles.sections for column in _section_forces(motion, section, held)]
    branches = [_branch(motion, rate, held) for rate in poles.rates]
    return np.column_stack([*direct[: poles.direct], *sections, *branches])


def slope_forces(motion: Motion | JoinedMotions, poles: Poles, linear: np.ndarray, held: bool) -> np.ndarray:
    """Differentiate the force by `Poles.logarithms` with fixed linear parameters; shape (samples, searched parameters)."""
    if isinstance(motion, JoinedMotions):
        return np.concatenate([slope_forces(part, poles, linear, held) for part in motion.parts])
    slopes = []
    if poles.delay:
        later = replace(poles, delay=poles.delay * (1 + _STEP))
        difference = forces(motion, later, held) - forces(motion, poles, held)
        slopes.append(difference @ linear / _STEP)
    delayed = _delayed(motion, poles.delay)
    gains = linear[len(linear) - poles.order :]
    for index, section in enumerate(poles.sections):
        pair = gains[2 * index : 2 * index + 2]
        present = np.column_stack(_section_forces(delayed, section, held)) @ pair
        for step in _STEP * np.eye(2):
            moved = np.column_stack(_section_forces(delayed, section * (1 + step), held)) @ pair
            slopes.append((moved - present) / _STEP)
    for rate, gain in zip(poles.rates, gains[2 * len(poles.sections) :], strict=True):
        difference = _branch(delayed, rate * (1 + _STEP), held) - _branch(delayed, rate, held)
        slopes.append(difference * gain / _STEP)
    return np.column_stack(slopes)


def _delayed(motion: Motion, delay: float) -> Motion:
    if not delay:
        return motion
    return motion.cache.compute_at("late", np.array([delay]), lambda: motion.delayed(delay))


def _section_forces(motion: Motion, section: np.ndarray, held: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses of √a₀/(s² + a₁ s + a₀) and s/(s² + a₁ s + a₀) to the velocity, from two branches."""
    damping, square = section
    scale = np.sqrt(square)
    root = np.sqrt(complex(damping**2 / 4 - square))
    if abs(root) < _MIN_DISTANCE * scale:
        root = _MIN_DISTANCE * scale * (1 if root.imag == 0 else 1j)
    first, second = -damping / 2 + root, -damping / 2 - root
    if root.imag:
        response = _branch(motion, -first, held)
        slow = response.imag / root.imag
        fast = (first * response).imag / root.imag
    else:
        one, other = _branch(motion, -first.real, held), _branch(motion, -second.real, held)
        slow = (one - other) / (2 * root.real)
        fast = (first.real * one - second.real * other) / (2 * root.real)
    return scale * slow, fast


def _branch(motion: Motion, rate: complex, held: bool) -> np.ndarray:
    """Return the response of 1/(s + rate) to the velocity; the rate may be complex."""
    if not held:
        return relaxation(motion, 1 / rate)
    return filtered([1.0], [1.0, -np.exp(-rate * motion.sampling_time)], motion.increments)


def relocate_poles(data: FitData, order: int, low: float, high: float, held: bool) -> list[Poles]:
    """Find poles of a linear model from its input and output without a start, by relocation (vector fitting).

    The method is Steiglitz and McBride's iteration in partial fractions, which remains well conditioned if all poles are slow
    compared with the sampling (Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052-1061; in the time domain
    Grivet-Talocia, IEEE Trans. Circuits Syst. I 50 (2003) 1444-1456). It starts from pairs between `low` and `high` in 1/s.

    Return `order` poles after each iteration, in the order of iterations; `held` is true if the input is a zero-order hold.
    """
    sizes = np.geomspace(low, high, order // 2 + order % 2 + 2)[1:-1]
    pairs = sizes[order % 2 :] * np.exp(1j * (np.pi - np.arccos(_START_DAMPING)))
    places, results = np.concatenate([-sizes[: order % 2], pairs, pairs.conj()]), []
    for _ in range(_ITERATIONS):
        places = np.clip(np.abs(places), 1e-2 * low, 1e2 * high) * np.exp(1j * np.angle(places))
        poles = Poles.from_places(places)
        # The new poles are the zeros of σ = 1 + Σ kᵢ/(s − pᵢ) for which σ F is a numerator over the present poles.
        state, inputs = _real_form(poles)
        columns = data.whiten(np.column_stack([forces(data.motion, poles, held), _filter_force(data, poles)]))
        size = np.sqrt(np.mean(columns**2, axis=0))
        size[size == 0] = 1.0
        solution = np.linalg.lstsq(columns / size, data.whiten(data.force), rcond=1e-9)[0] / size
        places = np.linalg.eigvals(state + np.outer(inputs, solution[-poles.order :]))
        if not np.isfinite(places).all():
            break
        results.append(Poles.from_places(places))
    return results


def _real_form(poles: Poles) -> tuple[np.ndarray, np.ndarray]:
    """Return the state matrix and the input vector with the responses of `_filter_force` as states."""
    state, inputs = np.zeros((poles.order, poles.order)), np.zeros(poles.order)
    for index, (damping, square) in enumerate(poles.sections):
        rows = slice(2 * index, 2 * index + 2)
        state[rows, rows] = [[0.0, 1.0], [-square, -damping]]
        inputs[2 * index + 1] = 1.0
    for index, rate in enumerate(poles.rates, start=2 * len(poles.sections)):
        state[index, index], inputs[index] = -rate, 1.0
    return state, inputs


def _filter_force(data: FitData, poles: Poles) -> np.ndarray:
    """Filter the force by the state equations of `_real_form`, with a first-order hold, shape (samples, order)."""
    parts = data.motion.split(data.force) if isinstance(data.motion, JoinedMotions) else [data.force]
    transfers = []
    for damping, square in poles.sections:
        transfers += [([1.0], [1.0, damping, square]), ([1.0, 0.0], [1.0, damping, square])]
    transfers += [([1.0], [1.0, rate]) for rate in poles.rates]
    columns, step = [], data.motion.sampling_time
    for transfer in transfers:
        (numerator,), denominator, _ = scipy.signal.cont2discrete(transfer, step, method="foh")
        responses = [scipy.signal.lfilter(numerator, denominator, part - part[0]) for part in parts]
        columns.append(np.concatenate(responses))
    return np.column_stack(columns)


_NAME = "linear_dynamics"
_DIRECT = (
    ("k", "z", "stiffness", "{y}/{x}"),
    ("b", "v", "viscosity", "{y} s/{x}"),
    ("m", "a", "mass", "{y} s^2/{x}"),
)
"""Symbol, signal, name and unit of the direct terms."""


def linear_base(poles: Poles, held: bool) -> Base | None:
    """Return a base with the equation of a linear model; a fit of the base starts at these poles.

    Return None if the input is a zero-order hold (`held`), with a delay, or with more poles than an equation may have states.
    """
    if held or poles.delay or poles.order > MOST_STATES:
        return None
    direct = _DIRECT[: poles.direct - 1]
    terms = [f"{symbol}*{signal}" for symbol, signal, *_ in direct]
    parameters = {symbol: _linear(name, unit) for symbol, _, name, unit in direct}
    states = {}
    for number, (damping, square) in enumerate(poles.sections, 1):
        # A pair of poles, s² + a s + c: its state p and the rate w of that.
        slow, fast, a, c, f, g = (f"{letter}_{number}" for letter in "pwacfg")
        states |= {slow: fast, fast: f"v - {a}*{fast} - {c}*{slow}"}
        terms += [f"{f}*{slow}", f"{g}*{fast}"]
        parameters |= {
            f: _linear(f"pair_stiffness_rate_{number}", "{y}/({x} s)"),
            g: _linear(f"pair_stiffness_{number}", "{y}/{x}"),
            a: _nonlinear(f"pair_damping_{number}", "1/s", damping),
            c: _nonlinear(f"pair_frequency_squared_{number}", "1/s^2", square),
        }
    for number, rate in enumerate(poles.rates, 1):
        state, stiffness, symbol = (f"{letter}_{number}" for letter in "qhr")
        states[state] = f"v - {symbol}*{state}"
        terms.append(f"{stiffness}*{state}")
        parameters |= {
            stiffness: _linear(f"branch_stiffness_{number}", "{y}/{x}"),
            symbol: _nonlinear(f"relaxation_rate_{number}", "1/s", rate),
        }
    definition = {
        "name": _NAME,
        "mechanism": f"Linear dynamics of {plural(poles.order, 'pole')}, without names.",
        "equation": " + ".join(terms),
        "state": states,
        "parameters": parameters,
    }
    return read_model_bases({"bases": {_NAME: definition}})[_NAME]


def _linear(name: str, unit: str) -> dict:
    return {"name": name, "unit": unit, "sign": "any"}


def _nonlinear(name: str, unit: str, value: float) -> dict:
    return {"name": name, "unit": unit, "start": [float(value)] * 2, "scale": "one", "points": 1}
