"""Base models that effects are added to: linear in all parameters but their time constants."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.errors import InputError
from lumbar.models.c_step import CStep
from lumbar.models.equation import Solution
from lumbar.models.form import Form, LinearParameter, NonlinearParameter, Place
from lumbar.models.motion import Motion
from lumbar.models.operators import relaxation

_RESPONSES = {"tissue": "F", "pendulum": "M"}
"""Symbol of what a base of each system gives."""


@dataclass(frozen=True)
class Base:
    """A base model.

    Attributes
    ----------
    name : str
        As in the thesis: ``"KB"`` ….
    equation : str
        Expression of its force, as of a parallel `Form`.
    linear, nonlinear : tuple
        Parameters.
    state : tuple of (str, str)
        States and their rates of change, as of a `Form`.
    solution : callable, optional
        The states in closed form.
    system : str
        What it is a model of, which decides the catalogue of effects: ``tissue`` or ``pendulum``.
    """

    name: str
    equation: str
    linear: tuple[LinearParameter, ...]
    nonlinear: tuple[NonlinearParameter, ...] = ()
    state: tuple[tuple[str, str], ...] = ()
    solution: Solution | None = None
    system: str = "tissue"

    @cached_property
    def form(self) -> Form:
        """The base as a form: what it adds to the force is all of it."""
        return Form(
            name=self.name,
            equation=self.equation,
            place=Place.PARALLEL,
            linear=self.linear,
            nonlinear=self.nonlinear,
            state=self.state,
            solution=self.solution,
            effect="base",
        )

    @property
    def text(self) -> str:
        """The equation in plain text."""
        return f"{_RESPONSES[self.system]} = {self.form.text}"

    @property
    def latex(self) -> str:
        """The equation in LaTeX."""
        return f"{_RESPONSES[self.system]} = {self.form.latex}"

    @property
    def c_step(self) -> CStep | None:
        """The sum of its forces in C, sample by sample."""
        return self.form.c_step

    def columns(self, motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Forces, one per linear parameter at size 1, each of shape (samples,)."""
        return self.form.columns(motion, nonlinear)


_SPRING = LinearParameter("spring_stiffness", "{y}/{x}", symbol="k_e")
_BRANCH = LinearParameter("branch_stiffness", "{y}/{x}", symbol="k_b")
_RELAXATION = NonlinearParameter("relaxation_time", "s", "time", 0.02, 2.0, 5, reach=(0.4, 4.0), symbol="tau")
MAXWELL_STATE = (("q", "v - q/tau"),)
"""Elongation of the spring of a Maxwell branch."""


def elongation(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray]:
    """State of a Maxwell branch whose relaxation time is the only nonlinear parameter."""
    return (relaxation(motion, nonlinear[0]),)


BASES = {
    base.name: base
    for base in (
        Base("LE", "k_e*z", (_SPRING,)),
        Base("Maxwell", "k_b*q", (_BRANCH,), (_RELAXATION,), MAXWELL_STATE, elongation),
        Base("KV", "k_e*z + b*v", (_SPRING, LinearParameter("viscosity", "{y} s/{x}", symbol="b"))),
        Base("KB", "k_e*z + k_b*q", (_SPRING, _BRANCH), (_RELAXATION,), MAXWELL_STATE, elongation),
        Base(
            "pendulum",
            "I*theta_ddot + b*theta_dot + G*sin(theta)",
            (
                LinearParameter("inertia", "{y} s^2/{x}", symbol="I"),
                LinearParameter("damping", "{y} s/{x}", symbol="b"),
                LinearParameter("gravity_moment", "{y}", 0, symbol="G", latex=r"m g \ell"),
            ),
            system="pendulum",
        ),
    )
}
"""Base models by name.

KB is the Kelvin–Boltzmann model: a spring beside a Maxwell branch. The pendulum is Eq. 4.1: M is the moment that
the person exerts at the pivot, positive with the angle θ from the vertical (not centred). Its gravity moment has the
sign the data give it: m g ℓ > 0 where θ counts from straight down (hanging, as published), −m g ℓ < 0 where it counts
from straight up (inverted).
"""


def base_named(name: str) -> Base:
    """Base model of a name.

    Raises
    ------
    InputError
        For an unknown one, with those that there are.
    """
    if name not in BASES:
        raise InputError(f"unknown base model {name!r}; known are {', '.join(BASES)}")
    return BASES[name]
