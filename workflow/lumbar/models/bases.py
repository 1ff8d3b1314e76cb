"""Base models that effects are added to: linear in all parameters but their time constants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lumbar.models.c_step import RELAX, CStep, ramp_relaxation
from lumbar.models.form import Columns, LinearParameter, NonlinearParameter
from lumbar.models.operators import relaxation


@dataclass(frozen=True)
class Base:
    """A base model.

    Attributes
    ----------
    name : str
        As in the thesis: ``"KB"`` ….
    equation : str
        LaTeX.
    linear, nonlinear : tuple
        Parameters in the order in which `columns` takes them.
    columns : callable
        From motion and nonlinear parameters to one force per linear parameter, each of shape (samples,).
    c_step : CStep
        The sum of these forces in C, sample by sample.
    system : str
        What it is a model of, which decides the catalogue of effects: ``tissue`` or ``pendulum``.
    """

    name: str
    equation: str
    linear: tuple[LinearParameter, ...]
    nonlinear: tuple[NonlinearParameter, ...]
    columns: Columns
    c_step: CStep
    system: str = "tissue"


_SPRING = LinearParameter("spring_stiffness", "{y}/{x}")
_BRANCH = LinearParameter("branch_stiffness", "{y}/{x}")
_RELAXATION = NonlinearParameter("relaxation_time", "s", "time", 0.02, 2.0, 5, reach=(0.4, 4.0))

BASES = {
    base.name: base
    for base in (
        Base(
            "LE",
            r"F = k z",
            (_SPRING,),
            (),
            lambda motion, _: [motion.position],
            CStep("spring_stiffness * position"),
        ),
        Base(
            "Maxwell",
            r"F = k q,\quad \dot q = \dot z - q/\tau",
            (_BRANCH,),
            (_RELAXATION,),
            lambda motion, nonlinear: [relaxation(motion, nonlinear[0])],
            CStep("branch_stiffness * next[0]", RELAX, memory=1, constants=ramp_relaxation),
        ),
        Base(
            "KV",
            r"F = k z + b \dot z",
            (_SPRING, LinearParameter("viscosity", "{y} s/{x}")),
            (),
            lambda motion, _: [motion.position, motion.velocity],
            CStep("spring_stiffness * position + viscosity * velocity"),
        ),
        Base(
            "KB",
            r"F = k_e z + k_b q,\quad \dot q = \dot z - q/\tau",
            (_SPRING, _BRANCH),
            (_RELAXATION,),
            lambda motion, nonlinear: [motion.position, relaxation(motion, nonlinear[0])],
            CStep(
                "spring_stiffness * position + branch_stiffness * next[0]",
                RELAX,
                memory=1,
                constants=ramp_relaxation,
            ),
        ),
        Base(
            "pendulum",
            r"M = I \ddot\theta + b \dot\theta + m g \ell \sin\theta",
            (
                LinearParameter("inertia", "{y} s^2/{x}"),
                LinearParameter("damping", "{y} s/{x}"),
                LinearParameter("gravity_moment", "{y}", sign=0),
            ),
            (),
            lambda motion, _: [motion.acceleration, motion.velocity, np.sin(motion.position)],
            CStep(
                "inertia * acceleration + damping * velocity + gravity_moment * portable_sine(position / turn)",
                constants=lambda parameters, sampling_time: {"turn": 2 * math.pi},
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
