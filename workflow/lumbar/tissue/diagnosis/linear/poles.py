"""Poles of a linear time-invariant model from position to force, and its forces, one per linear parameter."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy

from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.effects.catalogue import carried_bases
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.motion import JoinedMotions, Motion
from lumbar.tissue.models.operators import relaxation
from lumbar.tissue.models.state_equation import MOST_STATES
from lumbar.tissue.models.transfer_function import filtered

_STEP = 1e-5
"""Relative step of derivatives by poles and delay."""
_APART = 1e-3
"""Relative distance of two real poles below which they count as that far apart: their responses differ else too little."""
_ITERATIONS = 6
_DAMPING = 0.3
"""Damping ratio of the starting pairs of poles."""


@dataclass(frozen=True, eq=False)
class Poles:
    """Poles of a strictly stable model, in the left half-plane by construction."""

    rates: np.ndarray
    """Shape (branches,): real poles at −rate (1/s): each a relaxing (Maxwell) branch of time constant 1/rate."""
    sections: np.ndarray
    """Shape (sections, 2): pairs of poles, roots of s² + a₁ s + a₀ with a₁ (1/s) and a₀ (1/s²) positive: complex or real.
    """
    delay: float = 0.0
    """Seconds by which the force follows the position late."""
    direct: int = 4
    """Number of direct terms, in this order: the constant, the position and its two derivatives."""

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.rates) + 2 * len(self.sections)

    @classmethod
    def of(cls, values: np.ndarray) -> Self:
        """Poles at these places (1/s), unstable ones reflected."""
        values = np.asarray(values, dtype=complex)
        tiny = 1e-6 * np.abs(values)
        upper = values[values.imag > tiny]
        real = np.sort(
            np.maximum(
                np.abs(values[np.abs(values.imag) <= tiny].real), 1e-12 * np.abs(values).max(initial=0.0)
            )
        )
        damped = np.maximum(np.abs(upper.real), 1e-6 * np.abs(upper))
        pairs = [(2 * alpha, alpha**2 + pole.imag**2) for alpha, pole in zip(damped, upper, strict=True)]
        pairs += [(slow + fast, slow * fast) for slow, fast in zip(real[0:-1:2], real[1::2], strict=True)]
        return cls(real[len(real) - len(real) % 2 :], np.array(pairs).reshape(-1, 2))

    def to_array(self) -> np.ndarray:
        """Places of the poles (1/s), complex."""
        pairs = [np.roots([1.0, *section]) for section in self.sections]
        return np.concatenate([-self.rates, *pairs]).astype(complex)

    def to_vector(self) -> np.ndarray:
        """Logarithms of all that is searched: the delay where there is one, sections, rates."""
        delay = [self.delay] if self.delay else []
        return np.log([*delay, *self.sections.ravel(), *self.rates])

    def with_vector(self, vector: np.ndarray) -> Self:
        """Poles of the same kind with other values, as `to_vector` gives them."""
        values, late = np.exp(vector), int(self.delay > 0)
        paired = late + self.sections.size
        return replace(
            self,
            rates=values[paired:],
            sections=values[late:paired].reshape(-1, 2),
            delay=float(values[0]) if late else 0.0,
        )


def forces(motion: Motion | JoinedMotions, poles: Poles, held: bool) -> np.ndarray:
    """Return the forces of the linear parameters at size 1, all from rest at the first position.

    The columns are those of a constant, of the position and of its derivatives, two of each section, and those of the branches;
    shape (samples, parameters). An input that is held between jumps acts through its present and its last value instead of
    its derivatives. With a delay there is no acceleration: small delays have nearly the same effect.
    """
    if isinstance(motion, JoinedMotions):
        return np.concatenate([forces(part, poles, held) for part in motion.parts])
    motion = _late(motion, poles.delay)
    one, position = np.ones(len(motion)), motion.position
    if held:
        direct = [one, position, np.append(position[:1], position[:-1])]
    else:
        direct = [one, position, motion.velocity, *([] if poles.delay else [motion.acceleration])]
    sections = [column for section in poles.sections for column in section_forces(motion, section, held)]
    branches = [_branch(motion, rate, held) for rate in poles.rates]
    return np.column_stack([*direct[: poles.direct], *sections, *branches])


def slope_forces(motion: Motion | JoinedMotions, poles: Poles, linear: np.ndarray, held: bool) -> np.ndarray:
    """Derivatives of the force by what `Poles.to_vector` gives, linear parameters kept; by differences.

    The result has shape (samples, searched parameters).
    """
    if isinstance(motion, JoinedMotions):
        return np.concatenate([slope_forces(part, poles, linear, held) for part in motion.parts])
    slopes = []
    if poles.delay:
        later = replace(poles, delay=poles.delay * (1 + _STEP))
        difference = forces(motion, later, held) - forces(motion, poles, held)
        slopes.append(difference @ linear / _STEP)
    late = _late(motion, poles.delay)
    gains = linear[len(linear) - poles.order :]
    for index, section in enumerate(poles.sections):
        own = gains[2 * index : 2 * index + 2]
        present = np.column_stack(section_forces(late, section, held)) @ own
        for which in (0, 1):
            moved = section * (1 + _STEP * np.eye(2)[which])
            slopes.append((np.column_stack(section_forces(late, moved, held)) @ own - present) / _STEP)
    for rate, gain in zip(poles.rates, gains[2 * len(poles.sections) :], strict=True):
        slopes.append((_branch(late, rate * (1 + _STEP), held) - _branch(late, rate, held)) * gain / _STEP)
    return np.column_stack(slopes)


def _late(motion: Motion, delay: float) -> Motion:
    return (
        motion.cache.compute_at("late", np.array([delay]), lambda: motion.delayed(delay)) if delay else motion
    )


def section_forces(motion: Motion, section: np.ndarray, held: bool) -> tuple[np.ndarray, np.ndarray]:
    """Responses of a₀/(s² + a₁ s + a₀) and √a₀ s/(s² + a₁ s + a₀) to the velocity, times 1/√a₀, from two branches."""
    damping, square = section
    scale = np.sqrt(square)
    root = np.sqrt(complex(damping**2 / 4 - square))
    if abs(root) < _APART * scale:
        root = _APART * scale * (1 if root.imag == 0 else 1j)
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
    """Response of 1/(s + rate) to the velocity; the rate may be complex."""
    if not held:
        return relaxation(motion, 1 / rate)
    return filtered([1.0], [1.0, -np.exp(-rate * motion.sampling_time)], motion.increments)


def relocated_poles(data: FitData, order: int, low: float, high: float, held: bool) -> list[Poles]:
    """Find poles of a linear model from its input and output without a start, by relocation (vector fitting).

    Steiglitz and McBride's iteration in partial fractions, which stays well conditioned if all poles are slow compared with the
    sampling (Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052-1061; in the time domain Grivet-Talocia, IEEE
    Trans. Circuits Syst. I 50 (2003) 1444-1456). It begins with pairs spread evenly over a band.

    Return `order` poles after each iteration, the last one last. The starting poles are between `low` and `high`
    in 1/s; `held` says whether the input is held between jumps.
    """
    sizes = np.geomspace(low, high, order // 2 + order % 2 + 2)[1:-1]
    pairs = sizes[order % 2 :] * np.exp(1j * (np.pi - np.arccos(_DAMPING)))
    poles, found = np.concatenate([-sizes[: order % 2], pairs, pairs.conj()]), []
    for _ in range(_ITERATIONS):
        poles = np.clip(np.abs(poles), 1e-2 * low, 1e2 * high) * np.exp(1j * np.angle(poles))
        shaped = Poles.of(poles)
        poles = _relocate(data, shaped, held)
        if not np.isfinite(poles).all():
            break
        found.append(Poles.of(poles))
    return found


def _relocate(data: FitData, poles: Poles, held: bool) -> np.ndarray:
    """Zeros of σ = 1 + Σ kᵢ/(s − pᵢ) such that σ F is a numerator over the same poles."""
    state, inputs = _real_form(poles)
    filtered = _filtered_forces(data, poles)
    columns = np.column_stack([forces(data.motion, poles, held), filtered])
    columns = data.whiten(columns)
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0] = 1.0
    solution = np.linalg.lstsq(columns / size, data.whiten(data.force), rcond=1e-9)[0] / size
    gains = -solution[-poles.order :]
    return np.linalg.eigvals(state - np.outer(inputs, gains))


def _real_form(poles: Poles) -> tuple[np.ndarray, np.ndarray]:
    """State matrix and input vector whose states are the responses that `_filtered_forces` gives."""
    order = poles.order
    state, inputs = np.zeros((order, order)), np.zeros(order)
    for index, (damping, square) in enumerate(poles.sections):
        at = 2 * index
        state[at, at + 1], state[at + 1, at], state[at + 1, at + 1] = 1.0, -square, -damping
        inputs[at + 1] = 1.0
    for index, rate in enumerate(poles.rates, start=2 * len(poles.sections)):
        state[index, index], inputs[index] = -rate, 1.0
    return state, inputs


def _filtered_forces(data: FitData, poles: Poles) -> np.ndarray:
    """Force through the state equations of `_real_form`, taken as linear between samples, shape (samples, order)."""
    parts = data.motion.split(data.force) if isinstance(data.motion, JoinedMotions) else [data.force]
    transfers = []
    for damping, square in poles.sections:
        transfers += [([1.0], [1.0, damping, square]), ([1.0, 0.0], [1.0, damping, square])]
    transfers += [([1.0], [1.0, rate]) for rate in poles.rates]
    columns = []
    for transfer in transfers:
        (numerator,), denominator, _ = scipy.signal.cont2discrete(
            transfer, data.motion.sampling_time, method="foh"
        )
        columns.append(
            np.concatenate([scipy.signal.lfilter(numerator, denominator, part - part[0]) for part in parts])
        )
    return np.column_stack(columns)


NAME = "linear_dynamics"
_DIRECT = (
    ("k", "z", "stiffness", "{y}/{x}"),
    ("b", "v", "viscosity", "{y} s/{x}"),
    ("m", "a", "mass", "{y} s^2/{x}"),
)
"""Symbol, signal, name and unit of the direct terms."""


def linear_base(poles: Poles, held: bool) -> Base | None:
    """The base whose equation a linear model with these poles is; a fit begins at them.

    None for an input that is held between jumps, behind a delay, and for more poles than an equation has states.
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
        "name": NAME,
        "mechanism": f"Linear dynamics of {poles.order} poles, without names.",
        "equation": " + ".join(terms),
        "state": states,
        "parameters": parameters,
    }
    return carried_bases({"bases": {NAME: definition}})[NAME]


def _linear(name: str, unit: str) -> dict:
    return {"name": name, "unit": unit, "sign": "any"}


def _nonlinear(name: str, unit: str, value: float) -> dict:
    start = [float(value), float(value)]
    return {"name": name, "unit": unit, "start": start, "scale": "one", "points": 1}
