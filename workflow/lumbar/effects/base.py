"""Base models that effects are added to: linear in their amplitudes, with time constants as shapes."""

from __future__ import annotations

from dataclasses import dataclass

from lumbar.effects.c_step import RELAX, CStep, ramp_relaxation
from lumbar.effects.effect import Amplitude, Columns, Shape
from lumbar.effects.operators import relaxation


@dataclass(frozen=True)
class Base:
    """A base model.

    Attributes
    ----------
    name : str
        As in the thesis: ``"KB"`` ….
    equation : str
        LaTeX.
    amplitudes, shapes : tuple
        Parameters in the order in which `columns` takes them.
    columns : callable
        From motion and shapes to one force per amplitude, each of shape (samples,).
    c_step : CStep
        The sum of these forces in C, sample by sample.
    """

    name: str
    equation: str
    amplitudes: tuple[Amplitude, ...]
    shapes: tuple[Shape, ...]
    columns: Columns
    c_step: CStep


_SPRING = Amplitude("spring_stiffness", "{y}/{x}")
_BRANCH = Amplitude("branch_stiffness", "{y}/{x}")
_RELAXATION = Shape("relaxation_time", "s", "time", 0.02, 2.0, 5, reach=(0.4, 4.0))

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
            lambda motion, shapes: [relaxation(motion, shapes[0])],
            CStep("branch_stiffness * next[0]", RELAX, memory=1, constants=ramp_relaxation),
        ),
        Base(
            "KV",
            r"F = k z + b \dot z",
            (_SPRING, Amplitude("viscosity", "{y} s/{x}")),
            (),
            lambda motion, _: [motion.position, motion.velocity],
            CStep("spring_stiffness * position + viscosity * velocity"),
        ),
        Base(
            "KB",
            r"F = k_e z + k_b q,\quad \dot q = \dot z - q/\tau",
            (_SPRING, _BRANCH),
            (_RELAXATION,),
            lambda motion, shapes: [motion.position, relaxation(motion, shapes[0])],
            CStep(
                "spring_stiffness * position + branch_stiffness * next[0]",
                RELAX,
                memory=1,
                constants=ramp_relaxation,
            ),
        ),
    )
}
"""Base models by name. KB is the Kelvin–Boltzmann model: a spring beside a Maxwell branch."""
