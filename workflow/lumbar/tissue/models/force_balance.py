"""The balance of forces of a model, R(z, ż, z̈, states, t) = F, from the one equation of its base and of every form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.models.derivative import derivative
from lumbar.tissue.models.evaluation import Evaluator
from lumbar.tissue.models.expression import (
    Expression,
    Number,
    Symbol,
    add,
    multiply,
    substituted,
    symbols,
)
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion_signals import SIGNALS
from lumbar.tissue.models.parsing import parse

MOTION = ("z", "v", "a")
"""Symbols of position, velocity and acceleration."""
_PATH_RATE = parse("abs(v)")
_KNOWN = {*MOTION, "s", "t"}
"""Signals that a simulation from force to motion has."""


def can_be_simulated(form: Form) -> bool:
    """Whether a parallel form can stand in a balance of forces: an equation says it, in signals that a simulation has."""
    if form.hand_written or form.place is not Place.PARALLEL:
        return False
    equation = form.parsed
    used = set().union(*map(symbols, (equation.force, *equation.slopes.values()))) & SIGNALS.keys()
    try:
        for symbol in (*MOTION, *equation.slopes):
            for tree in (equation.force, *equation.slopes.values()):
                derivative(tree, symbol)
    except InputError:  # a state or the motion in an exponent
        return False
    return used <= _KNOWN


@dataclass(frozen=True)
class ForceBalance:
    """Forces of a model that is driven by a force."""

    pieces: tuple[Form, ...]
    """The base as a form, then the forms beside it."""

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Symbols of the linear parameters, piece by piece."""
        return tuple(
            _own(item.symbol, index) for index, form in enumerate(self.pieces) for item in form.linear
        )

    @cached_property
    def nonlinear(self) -> tuple[str, ...]:
        """Symbols of the nonlinear parameters, piece by piece."""
        return tuple(
            _own(item.symbol, index) for index, form in enumerate(self.pieces) for item in form.nonlinear
        )

    @cached_property
    def force(self) -> Expression:
        """R, each piece with symbols of its own."""
        terms = []
        for index, form in enumerate(self.pieces):
            names = self._names(index)
            for item, column in zip(form.linear, form.parsed.columns, strict=True):
                terms.append(multiply(Symbol(_own(item.symbol, index)), substituted(column, names)))
        return reduce(add, terms)

    @cached_property
    def rates(self) -> dict[str, Expression]:
        """Rate of change of every state; the path travelled is one where it is asked for."""
        found = {
            _own(name, index): substituted(slope, self._names(index))
            for index, form in enumerate(self.pieces)
            for name, slope in form.parsed.slopes.items()
        }
        if "s" in set().union(*map(symbols, (self.force, *found.values()))):
            found["s"] = _PATH_RATE
        return found

    def _names(self, index: int) -> dict[str, Expression]:
        form = self.pieces[index]
        given: dict[str, Expression] = {item.symbol: Number(item.value) for item in form.constants}
        own = [item.symbol for item in (*form.linear, *form.nonlinear)] + [name for name, _ in form.state]
        return given | {name: Symbol(_own(name, index)) for name in own}

    @property
    def states(self) -> tuple[str, ...]:
        """Symbols of the states."""
        return tuple(self.rates)

    @cached_property
    def _values(self) -> Evaluator:
        return Evaluator([self.force, *self.rates.values()])

    @cached_property
    def _slopes(self) -> Evaluator:
        trees = (self.force, *self.rates.values())
        return Evaluator(
            [*trees, *(derivative(tree, name) for tree in trees for name in (*MOTION, *self.states))]
        )

    def values(self, known: Mapping[str, np.ndarray | float], shape: tuple[int, ...]) -> np.ndarray:
        """R and the states' rates, shape (1 + states, *shape)."""
        return np.array([np.broadcast_to(item, shape) for item in self._values(known)], dtype=float)

    def slopes(
        self, known: Mapping[str, np.ndarray | float], shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The same, and their derivatives by z, ż, z̈ and the states, shape (1 + states, 3 + states, *shape)."""
        count = 1 + len(self.states)
        found = [np.broadcast_to(item, shape) for item in self._slopes(known)]
        return (
            np.array(found[:count], dtype=float),
            np.array(found[count:], dtype=float).reshape(count, len(MOTION) + count - 1, *shape),
        )


def _own(symbol: str, index: int) -> str:
    """Symbol of a piece: two forms may call different things alike."""
    return f"{symbol}__{index}"
