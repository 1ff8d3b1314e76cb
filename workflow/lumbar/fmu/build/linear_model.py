"""A linear model: the transfer function of an identified model, and its C data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lumbar.models.state_space import observer_form
from lumbar.models.transfer_function import TransferFunction

if TYPE_CHECKING:
    import control

MAX_STATES = 16


@dataclass(frozen=True)
class LinearModel:
    """H(z) from deviations of the input to deviations of the output.

    Attributes
    ----------
    numerator, denominator : tuple of float
        Coefficients of z⁰, z⁻¹, z⁻², …
    name : str
        Stands in messages.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    name: str = "model"

    c_files = ("model_linear.c",)
    headers = ()
    waits_for_input = False

    @cached_property
    def state_space(self) -> control.StateSpace:
        """The model as Eqs 3.17 and 3.18 of the thesis."""
        return observer_form(TransferFunction(self.numerator, self.denominator))

    @property
    def states(self) -> int:
        """Numbers that the model keeps from sample to sample."""
        return self.state_space.nstates

    @property
    def largest_pole(self) -> float:
        """Largest magnitude of a pole; 0 without poles."""
        return float(np.abs(self.state_space.poles()).max(initial=0.0))

    @property
    def feedthrough(self) -> bool:
        """Whether the output depends on the input of the same sample."""
        return self.numerator[0] != 0.0

    def problems(self) -> list[tuple[str, str, str]]:
        """What keeps the model from being exported: place, what was found, what is allowed."""
        if self.states <= MAX_STATES:
            return []
        return [("order", f"{self.states} states", f"at most {MAX_STATES} fit into an FMU")]

    def response(self, inputs: np.ndarray) -> np.ndarray:
        """Return the output by the transfer function itself, from rest; shape (samples,)."""
        from scipy.signal import lfilter

        with np.errstate(over="ignore", invalid="ignore"):
            return lfilter(self.numerator, self.denominator, inputs)

    def late_response(self, inputs: np.ndarray) -> np.ndarray:
        """Return what an FMI 2.0 client reads: the feed-through one sample late, except at the start."""
        through = self.numerator[0] / self.denominator[0] * inputs
        return self.response(inputs) - through + np.concatenate([through[:1], through[:-1]])

    def rounding_bound(self, inputs: np.ndarray, outputs: np.ndarray) -> float:
        """Error relative to the largest output that rounding alone may cause.

        Every step rounds each of its terms by up to machine epsilon, and the poles carry each rounding on: their
        effect is at most the 1-norm of the impulse response of 1/denominator times that of one step.
        """
        from scipy.signal import lfilter

        impulse = np.zeros(len(inputs))
        impulse[0] = 1.0
        amplification = np.abs(lfilter([1.0], self.denominator, impulse)).sum()
        largest = np.abs(outputs).max()
        terms = np.abs(self.numerator).sum() * np.abs(inputs).max() + np.abs(self.denominator).sum() * largest
        return float(np.finfo(float).eps * amplification * terms / largest) if largest else 0.0

    def equations(self) -> list[str]:
        """Return the equations in plain text, one per line, numbers to six digits."""
        system, rows = self.state_space, []
        for index in range(system.nstates):
            terms = [(value, f"x{j + 1}[k]") for j, value in enumerate(system.A[index])]
            rows.append(f"x{index + 1}[k+1] = {_sum([*terms, (system.B[index, 0], 'u[k]')])}")
        terms = [(value, f"x{j + 1}[k]") for j, value in enumerate(system.C[0])]
        return [*rows, f"y[k] = {_sum([*terms, (system.D[0, 0], 'u[k]')])}"]

    def c_data(self) -> list[str]:
        """Lines of model_data.h: hexadecimal floats are exact, and the same text on every machine."""
        system = self.state_space
        # C has no arrays of length 0: a static gain gets one unused element.
        missing = (0, 0 if system.nstates else 1)
        matrix, column, row = (
            np.pad(system.A, missing),
            np.pad(system.B[:, 0], missing),
            np.pad(system.C[0], missing),
        )
        size = len(matrix)
        return [
            f"#define LINEAR_STATES {system.nstates}",
            f"static const double MODEL_A[{size}][{size}] = {{{', '.join(map(hex_row, matrix))}}};",
            f"static const double MODEL_B[{size}] = {hex_row(column)};",
            f"static const double MODEL_C[{size}] = {hex_row(row)};",
            f"#define MODEL_D {float(system.D[0, 0]).hex()}",
        ]


def hex_row(values) -> str:
    """Return a C initialiser of hexadecimal floats."""
    return "{" + ", ".join(float(value).hex() for value in values) + "}"


def _sum(terms: list[tuple[float, str]]) -> str:
    text = ""
    for value, symbol in terms:
        if value != 0.0:
            sign = ("−" if value < 0 else "") if not text else (" − " if value < 0 else " + ")
            text += f"{sign}{symbol}" if abs(value) == 1.0 else f"{sign}{abs(value):.6g} {symbol}"
    return text or "0"
