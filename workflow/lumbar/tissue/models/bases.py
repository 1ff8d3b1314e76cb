"""Base models that effects are added to: linear in all parameters but their time constants."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lumbar.tissue.models.equation import CStep, Solution
from lumbar.tissue.models.form import Form, HandWritten, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import relaxation, surface_of_branch, surface_of_dashpot
from lumbar.tissue.models.parameter import Constant

_RESPONSES = {"tissue": "F", "pendulum": "M"}
"""Symbol of what a base of each system gives."""


@dataclass(frozen=True)
class Base:
    """A base model."""

    name: str
    """As in the thesis: ``"KB"`` …."""
    equation: str
    """Expression of its force, as of a parallel `Form`."""
    linear: tuple[LinearParameter, ...]
    nonlinear: tuple[NonlinearParameter, ...] = ()
    """`linear`, `nonlinear`: parameters."""
    state: tuple[tuple[str, str], ...] = ()
    """States and their rates of change, as of a `Form`."""
    solution: Solution | None = None
    """The states in closed form."""
    system: str = "tissue"
    """What it is a model of, which decides the catalogue of effects: ``tissue`` or ``pendulum``."""
    sensor_zero: bool = True
    """Whether a sensor with a zero of its own gives the response, so that a constant belongs to every fit. A pendulum's
    moment is computed; a constant in it would be one of the person."""
    hand_written: HandWritten | None = None
    """Instead of the equation, as of a `Form`."""
    touching: Callable[[Motion, np.ndarray], np.ndarray] | None = None
    """For a tool that is not fastened to the tissue, which it meets at position 0 and never pulls: from motion and
    nonlinear parameters to whether it touches, (samples,). Where it does not, effects add no force."""
    start: tuple[tuple[str, str], ...] = ()
    """What the states begin with, as of a `Form`."""
    constants: tuple[Constant, ...] = ()
    """Numbers that the equations call by a symbol."""
    definition: Mapping | None = field(default=None, compare=False, repr=False)
    """Of a base of one's own: what its file says."""

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
            start=self.start,
            constants=self.constants,
            solution=self.solution,
            hand_written=self.hand_written,
            effect="base",
        )

    @property
    def contact(self) -> bool:
        """Whether the tool is not fastened to the tissue."""
        return self.touching is not None

    @property
    def own(self) -> bool:
        """Whether it is one of a user's own, which goes from whatever was put in to whatever was measured."""
        return self.definition is not None

    @property
    def _response(self) -> str:
        return "y" if self.own else _RESPONSES[self.system]

    @property
    def text(self) -> str:
        """The equation in plain text."""
        return f"{self._response} = {self.form.text}"

    @property
    def latex(self) -> str:
        """The equation in LaTeX."""
        return f"{self._response} = {self.form.latex}"

    @property
    def c_step(self) -> CStep | None:
        """The sum of its forces in C, sample by sample."""
        return self.form.c_step

    def columns(self, motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
        """Forces, one per linear parameter at size 1, each of shape (samples,)."""
        return self.form.columns(motion, nonlinear)


_SPRING = LinearParameter("spring_stiffness", "{y}/{x}", symbol="k_e")
_BRANCH = LinearParameter("branch_stiffness", "{y}/{x}", symbol="k_b")
_RELAXATION = NonlinearParameter(
    "relaxation_time", "s", "time", 0.02, 2.0, 5, reach=(0.4, 4.0), symbol="tau", follows_record=True
)
MAXWELL_STATE = (("q", "v - q/tau"),)
"""Elongation of the spring of a Maxwell branch."""


def elongation(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray]:
    """State of a Maxwell branch whose relaxation time is the only nonlinear parameter."""
    return (relaxation(motion, nonlinear[0]),)


_FASTENED = (
    Base("LE", "k_e*z", (_SPRING,)),
    Base("Maxwell", "k_b*q", (_BRANCH,), (_RELAXATION,), MAXWELL_STATE, elongation),
    Base("KV", "k_e*z + b*v", (_SPRING, LinearParameter("viscosity", "{y} s/{x}", symbol="b"))),
    Base("KB", "k_e*z + k_b*q", (_SPRING, _BRANCH), (_RELAXATION,), MAXWELL_STATE, elongation),
)

_MASS = LinearParameter("mass", "{y} s^2/{x}", symbol="m")
_WITH_MASS = (
    Base("KV-mass", "m*a + k_e*z + b*v", (_MASS, *_FASTENED[2].linear)),
    Base(
        "KB-mass",
        "m*a + k_e*z + k_b*q",
        (_MASS, *_FASTENED[3].linear),
        (_RELAXATION,),
        MAXWELL_STATE,
        elongation,
    ),
)


def _branch_meets(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ratio, time_constant = nonlinear
    return motion.remember(
        "branch_meets", nonlinear, lambda: surface_of_branch(motion, 1.0 / (1.0 + ratio), time_constant)
    )


def _branch_in_contact(motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
    dashpot, touching = _branch_meets(motion, nonlinear)
    ratio = nonlinear[0]
    return [touching * ((1.0 + ratio) * motion.position - ratio * dashpot)]


def _dashpot_meets(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return motion.remember("dashpot_meets", nonlinear, lambda: surface_of_dashpot(motion, nonlinear[0]))


def _dashpot_in_contact(motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
    surface, touching = _dashpot_meets(motion, nonlinear)
    return [touching * (surface + nonlinear[0] * motion.velocity)]


_FREE = r"\quad F \geq 0"
_TOUCHED = (
    Base("LE-contact", "k_e*max(z, 0)", (_SPRING,), touching=lambda motion, nonlinear: motion.position > 0),
    Base(
        "KV-contact",
        r"k_e\,(x + T \dot x)," + _FREE,
        (_SPRING,),
        (
            NonlinearParameter(
                "retardation_time",
                "s",
                "time",
                0.01,
                1.0,
                4,
                reach=(0.1, 4.0),
                symbol="T",
                follows_record=True,
            ),
        ),
        hand_written=HandWritten(columns=_dashpot_in_contact),
        touching=lambda motion, nonlinear: _dashpot_meets(motion, nonlinear)[1],
    ),
    Base(
        "KB-contact",
        r"k_e\,(x + \rho (x - w)),\quad \dot w = (x - w)/\tau," + _FREE,
        (_SPRING,),
        (
            NonlinearParameter("branch_ratio", "1", "one", 0.3, 10.0, 3, reach=(0.05, 20.0), symbol="rho"),
            _RELAXATION,
        ),
        hand_written=HandWritten(columns=_branch_in_contact),
        touching=lambda motion, nonlinear: _branch_meets(motion, nonlinear)[1],
    ),
)
_PENDULUM = Base(
    "pendulum",
    "I*theta_ddot + b*theta_dot + G*sin(theta)",
    (
        LinearParameter("inertia", "{y} s^2/{x}", symbol="I"),
        LinearParameter("damping", "{y} s/{x}", symbol="b"),
        LinearParameter("gravity_moment", "{y}", 0, symbol="G", latex=r"m g \ell"),
    ),
    system="pendulum",
    sensor_zero=False,
)

BASES = {base.name: base for base in (*_FASTENED, *_WITH_MASS, *_TOUCHED, _PENDULUM)}
"""Base models by name.

KB is the Kelvin–Boltzmann model: a spring beside a Maxwell branch. A tool that is not fastened to the tissue has the bases
with ``-contact``: positions count from the surface that it meets. The pendulum is Eq. 4.1: M is the moment that
the person exerts at the pivot, positive with the angle θ from the vertical (not centred). Its gravity moment has the
sign the data give it: m g ℓ > 0 where θ counts from straight down (hanging, as published), −m g ℓ < 0 where it counts
from straight up (inverted).
"""


CHOSEN_BY_DATA = "auto"
"""Name that stands for the base of a tissue that the data ask for."""
