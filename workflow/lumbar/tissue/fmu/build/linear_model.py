"""A linear model of an FMU: its transfer function, its C data, and its conversion to a faster loop."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy

from lumbar.base.errors import NumericalError
from lumbar.tissue.models.transfer_function import StateSpace, TransferFunction, filtered, observer_form

_INTEGRATOR_TOLERANCE = 1e-9
"""A pole this close to 1 counts as an integrator."""


@dataclass(frozen=True)
class LinearModel:
    """H(z) from deviations of the input to deviations of the output."""

    numerator: tuple[float, ...]
    """Coefficients of z⁰, z⁻ᵖ, z⁻²ᵖ, … with p phases."""
    denominator: tuple[float, ...]
    """Coefficients of z⁰, z⁻ᵖ, z⁻²ᵖ, … with p phases."""
    name: str = "model"
    """Name in messages."""
    delay: int = 0
    """Delay of the input in samples."""
    phases: int = 1
    """Number of copies of the model that run in turn, each on every `phases`-th sample."""

    axes = ()
    c_source = "model_linear.c"
    headers = ()
    waits_for_input = False
    histories = ()
    max_memory = 16

    @cached_property
    def state_space(self) -> StateSpace:
        """The model as Eqs 3.17 and 3.18 of the thesis."""
        return observer_form(TransferFunction(self.numerator, self.denominator))

    @property
    def states(self) -> int:
        """Number of values that the model stores from sample to sample."""
        return self.state_space.nstates

    @property
    def largest_pole(self) -> float:
        """Largest magnitude of a pole, per sample of the FMU; 0 without poles."""
        return float(np.abs(self.state_space.poles()).max(initial=0.0)) ** (1 / self.phases)

    @property
    def rests_anywhere(self) -> bool:
        """True if the model can rest at every constant input: it has no pole at 1."""
        return bool(np.all(np.abs(self.state_space.poles() - 1.0) > _INTEGRATOR_TOLERANCE))

    @property
    def feedthrough(self) -> bool:
        """True if the output depends on the input of the same sample."""
        return self.numerator[0] != 0.0 and self.delay == 0

    def response(self, inputs: np.ndarray, late: bool = False) -> np.ndarray:
        """Return the output of the transfer function, which starts at rest.

        `inputs` are deviations from rest, shape (samples,). If `late`, the feed-through (with effects: the whole output) is one
        sample late except at the start, as an FMI 2.0 client reads it.
        """
        delayed = np.concatenate([np.zeros(self.delay), inputs])[: len(inputs)]
        outputs = filtered(self._spread(self.numerator), self._spread(self.denominator), delayed)
        if late and self.feedthrough:
            through = self.numerator[0] / self.denominator[0] * inputs
            outputs = outputs - through + np.concatenate([through[:1], through[:-1]])
        return outputs

    @property
    def transfer_function(self) -> TransferFunction:
        """Transfer function H(z) at the FMU's samples, including delay and phases."""
        return TransferFunction(
            (*[0.0] * self.delay, *self._spread(self.numerator).tolist()),
            tuple(self._spread(self.denominator).tolist()),
        )

    def _spread(self, coefficients: tuple[float, ...]) -> np.ndarray:
        """Return the coefficients of all powers of 1/z, with zeros between the phases."""
        spread = np.zeros((len(coefficients) - 1) * self.phases + 1)
        spread[:: self.phases] = coefficients
        return spread

    def equations(self) -> list[str]:
        """Return the equations in plain text, one per line, numbers to six digits."""
        system, late = self.state_space, f"−{self.delay}" if self.delay else ""
        names = [f"x{index + 1}" for index in range(system.nstates)]
        heads = [*(f"{name}[k+{self.phases}]" for name in names), "y[k]"]
        symbols = [*(f"{name}[k]" for name in names), f"u[k{late}]"]
        lines = []
        for head, row in zip(heads, np.block([[system.A, system.B], [system.C, system.D]]), strict=True):
            text = ""
            for value, symbol in zip(row, symbols, strict=True):
                if value != 0.0:
                    sign = ("−" if value < 0 else "") if not text else (" − " if value < 0 else " + ")
                    text += f"{sign}{symbol}" if abs(value) == 1.0 else f"{sign}{abs(value):.6g} {symbol}"
            lines.append(f"{head} = {text or '0'}")
        return lines

    def c_data(self) -> list[str]:
        """Return the lines of model_data.h. Numbers are hexadecimal floats: exact, and equal on every machine."""
        system = self.state_space
        # State at rest at an input of 1; zeros if a pole at 1 allows no such state.
        rest = np.zeros(system.nstates)
        if system.nstates and self.rests_anywhere:
            rest = np.linalg.solve(np.eye(system.nstates) - system.A, system.B[:, 0])
        # C has no arrays of length 0: a static gain gets one unused element.
        missing = (0, 0 if system.nstates else 1)
        matrix = np.pad(system.A, missing)
        vectors = {"MODEL_B": system.B[:, 0], "MODEL_C": system.C[0], "MODEL_REST": rest}
        size = len(matrix)
        return [
            f"#define LINEAR_STATES {system.nstates}",
            f"static const double MODEL_A[{size}][{size}] = {{{', '.join(map(hex_row, matrix))}}};",
            *(
                f"static const double {name}[{size}] = {hex_row(np.pad(vector, missing))};"
                for name, vector in vectors.items()
            ),
            f"#define MODEL_D {float(system.D[0, 0]).hex()}",
        ]


def hex_row(values) -> str:
    """Return a C initialiser of hexadecimal floats."""
    return "{" + ", ".join(float(value).hex() for value in values) + "}"


_WHOLE_TOLERANCE = 1e-6
"""A number of samples counts as whole if it is this close to a whole number."""


def resample_model(model: LinearModel, sampling_time: float, wanted: float) -> LinearModel:
    """Return the model at another sampling time, exact for a position linear between the old samples.

    The identified model is the ramp-invariant (first-order hold) discretisation of a continuous model, which is
    discretised again at the new rate (G. F. Franklin, J. D. Powell and M. Workman, Digital Control of Dynamic Systems
    (1998), section 6.3). Leading zeros of the numerator are a delay, which is the same in seconds.

    A continuous model has no pole that is 0 or negative. If the identified model has one, it becomes H(z^r) with r new
    samples in an old one, exact at the old instants for any position (P. P. Vaidyanathan, Multirate Systems and Filter
    Banks (1993), section 4.2).

    `sampling_time` is the sampling time of the identified model, `wanted` the new sampling time, both in seconds.

    Raises
    ------
    NumericalError
        If the new rate is lower, or if no continuous model exists and the new rate is not a multiple of the old rate.
    """
    if (model.states == 0 and model.feedthrough) or wanted == sampling_time:
        return model
    if wanted > sampling_time:
        raise NumericalError(
            f"{model.name}: runtime.rate_Hz {1 / wanted:g} is slower than the {1 / sampling_time:g} Hz it was "
            "identified at, where faster motion would fold back; export it with runtime.rate_Hz: null"
        )
    ratio = sampling_time / wanted
    late = next((index for index, value in enumerate(model.numerator) if value != 0.0), 0)
    prompt = LinearModel(model.numerator[late:], model.denominator, model.name)
    poles = prompt.state_space.poles()
    unusable = (np.abs(poles.imag) < 1e-12 * np.abs(poles)) & (poles.real <= 0)
    if unusable.any() or np.abs(poles).min(initial=1.0) == 0:
        # No continuous model has such a pole: run the model on its own clock, once for every new sample in an old one.
        if abs(ratio - round(ratio)) > _WHOLE_TOLERANCE:
            poles = np.array2string(model.state_space.poles(), precision=4)
            raise NumericalError(
                f"{model.name}: a pole of {poles} is 0 or negative, which no continuous model has; set runtime.rate_Hz to "
                f"null or to a multiple of its own {1 / sampling_time:g} Hz"
            )
        return LinearModel(model.numerator, model.denominator, model.name, phases=round(ratio))
    delay, rest = divmod(late * ratio, 1.0)
    if min(rest, 1.0 - rest) < _WHOLE_TOLERANCE:
        delay, rest = round(late * ratio), 0.0
    if prompt.states == 0:
        numerator, denominator = (1.0 - rest, rest), (1.0,)
        numerator = tuple(prompt.numerator[0] / prompt.denominator[0] * value for value in numerator)
    else:
        numerator, denominator = _discretize(_continuous(prompt, sampling_time), wanted, rest, model.name)
    return LinearModel(numerator, denominator, model.name, int(delay))


@lru_cache(maxsize=64)
def _continuous(model: LinearModel, sampling_time: float) -> tuple[np.ndarray, ...]:
    """Return the continuous state space that becomes the model by ramp-invariant discretisation."""
    system, order = model.state_space, model.states
    a = np.real(scipy.linalg.logm(system.A)) / sampling_time
    # The result of the hold is linear in the input matrix: compute it for the identity. `scipy.signal.cont2discrete` does the
    # same, but its import takes longer than the check of a file.
    block = np.zeros((3 * order, 3 * order))
    block[:order, : 2 * order] = np.hstack([a, np.eye(order)]) * sampling_time
    block[order : 2 * order, 2 * order :] = np.eye(order)
    whole, first, through = np.split(scipy.linalg.expm(block)[:order], 3, axis=1)
    b = np.linalg.solve(first - through + whole @ through, system.B)
    return a, b, system.C, system.D - system.C @ through @ b


def _discretize(continuous: tuple, sampling_time: float, late: float, name: str) -> tuple[tuple, tuple]:
    """Return numerator and denominator of the ramp-invariant model; its input is delayed by the fraction `late` of a sample.

    The delayed input is linear with a corner at `late` within every sample: two first-order holds, one after the other.
    """
    a, b, c, d = continuous
    _, at_start, at_corner = _ramp(a, b, late * sampling_time)
    after, from_corner, at_end = _ramp(a, b, (1 - late) * sampling_time)
    # x[k+1] = whole x[k] + newest u[k+1] + new u[k] + old u[k-1]
    whole = scipy.linalg.expm(a * sampling_time)
    newest = at_end * (1 - late)
    new = after @ (at_start * (1 - late) + at_corner) + from_corner + at_end * late
    old = after @ at_start * late
    # In x − newest u, which needs no later input, and the input before as one more state.
    order = len(a)
    matrix = np.zeros((order + 1, order + 1))
    matrix[:order, :order], matrix[:order, order:] = whole, old
    column = np.vstack([new + whole @ newest, [[1.0]]])
    row = np.hstack([c, d * late])
    denominator = np.poly(matrix)
    numerator = np.poly(matrix - column @ row) + ((d * (1 - late) + c @ newest).item() - 1) * denominator
    if late == 0.0:  # the input before is without effect: both polynomials end in the zero of its state
        numerator, denominator = numerator[:-1], denominator[:-1]
    values = (tuple(map(float, numerator)), tuple(map(float, denominator)))
    if not all(map(math.isfinite, (*values[0], *values[1]))):
        raise NumericalError(f"{name}: it cannot be discretised again at {sampling_time:g} s")
    return values


def _ramp(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, ...]:
    """Return the matrices from the state, and from the first and last value of a linear input, to the state after a time."""
    order = len(a)
    block = np.zeros((order + 2, order + 2))
    block[:order, :order], block[:order, order : order + 1] = a * time, b * time
    block[order, order + 1] = 1.0
    exponential = scipy.linalg.expm(block)
    constant, rising = exponential[:order, order : order + 1], exponential[:order, order + 1 :]
    return exponential[:order, :order], constant - rising, rising
