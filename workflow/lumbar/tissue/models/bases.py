"""Base models that effects are added to: linear in all parameters but their time constants."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lumbar.base.yaml_file import shipped_yaml
from lumbar.tissue.models.form import Form, HandWritten, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import relaxation, surface_of_branch, surface_of_dashpot

_RESPONSES = {"tissue": "F", "pendulum": "M"}  # symbol of the response of a base of each system


@dataclass(frozen=True)
class Base:
    """A base model."""

    form: Form
    """Its whole force, with the thesis's name: ``"KB"`` …."""
    system: str = "tissue"
    """``tissue`` or ``pendulum``, which decides the catalogue of effects."""
    sensor_zero: bool = True
    """Whether the response is measured by a sensor with an unknown zero, so that every fit has a constant. A pendulum's moment
    is computed; a constant in it would be physical."""
    touching: Callable[[Any, np.ndarray], np.ndarray] | None = None
    """For a tool that is not fastened to the tissue, which it meets at position 0 and never pulls: from motion and
    nonlinear parameters to whether it touches, (samples,). Where it does not, effects add no force."""
    definition: Mapping | None = field(default=None, compare=False, repr=False)
    """Content of the file of a user-defined base."""
    spatial: Any = None
    """`lumbar.tissue.models.space.SpatialBase` of a tissue in space."""

    @property
    def name(self) -> str:
        """Name of its form."""
        return self.form.name

    @property
    def linear(self) -> tuple[LinearParameter, ...]:
        """Parameters that its force is proportional to."""
        return self.form.linear

    @property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """Its other parameters."""
        return self.form.nonlinear

    @cached_property
    def memory_key(self) -> Hashable:
        """Key of its forces in the cache of a motion."""
        return self.name if self.spatial is None else (self.name, self.spatial)

    @property
    def contact(self) -> bool:
        """Whether the tool is not fastened to the tissue."""
        return self.touching is not None

    @property
    def is_user_defined(self) -> bool:
        """Whether it is user-defined, from any input to any response."""
        return self.definition is not None

    @property
    def _response(self) -> str:
        return "y" if self.is_user_defined else _RESPONSES[self.system]

    @property
    def text(self) -> str:
        """The equation in plain text."""
        return f"{self._response} = {self.form.text}"

    @property
    def latex(self) -> str:
        """The equation in LaTeX."""
        return f"{self._response} = {self.form.latex}"


def elongation(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray]:
    """State of a Maxwell branch whose relaxation time is the only nonlinear parameter."""
    return (relaxation(motion, nonlinear[0]),)


def _branch_meets(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Dashpot of the branch of KB in contact, and whether the tool touches the tissue."""
    ratio, time_constant = nonlinear
    return motion.cache.compute_at(
        "branch_meets", nonlinear, lambda: surface_of_branch(motion, 1.0 / (1.0 + ratio), time_constant)
    )


def _branch_in_contact(motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
    dashpot, touching = _branch_meets(motion, nonlinear)
    return [touching * ((1.0 + nonlinear[0]) * motion.position - nonlinear[0] * dashpot)]


def _dashpot_meets(motion: Motion, nonlinear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Surface of KV in contact, and whether the tool touches the tissue."""
    return motion.cache.compute_at(
        "dashpot_meets", nonlinear, lambda: surface_of_dashpot(motion, nonlinear[0])
    )


def _dashpot_in_contact(motion: Motion, nonlinear: np.ndarray) -> list[np.ndarray]:
    surface, touching = _dashpot_meets(motion, nonlinear)
    return [touching * (surface + nonlinear[0] * motion.velocity)]


_HAND_WRITTEN = {
    "KV-contact": HandWritten(columns=_dashpot_in_contact),
    "KB-contact": HandWritten(columns=_branch_in_contact),
}
_TOUCHING: dict[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "LE-contact": lambda motion, nonlinear: motion.position > 0,
    "KV-contact": lambda motion, nonlinear: _dashpot_meets(motion, nonlinear)[1],
    "KB-contact": lambda motion, nonlinear: _branch_meets(motion, nonlinear)[1],
}


def _base(name: str, equation: str, parameters: Mapping, state: Mapping | None = None, **facts) -> Base:
    """A base of ``bases.yaml``, with what is written by hand; states are those of a Maxwell branch."""
    linear, nonlinear = [], []
    for symbol, item in parameters.items():
        if "scale" in item:
            nonlinear.append(NonlinearParameter(symbol=symbol, **item | {"reach": tuple(item["reach"])}))
        else:
            linear.append(LinearParameter(symbol=symbol, **item))
    form = Form(
        name,
        equation,
        Place.PARALLEL,
        tuple(linear),
        tuple(nonlinear),
        state=tuple((state or {}).items()),
        solution=elongation if state else None,
        hand_written=_HAND_WRITTEN.get(name),
        effect="base",
    )
    return Base(form, touching=_TOUCHING.get(name), **facts)


BASES = {
    name: _base(name, **said)
    for name, said in shipped_yaml(Path(__file__).with_suffix(".yaml"))["bases"].items()
}
"""Base models by name.

KB is the Kelvin–Boltzmann model: a spring parallel to a Maxwell branch. A tool that is not fastened to the tissue has the bases
with ``-contact``: positions count from the surface that it meets. The pendulum is Eq. 4.1: M is the moment that the person exerts
at the pivot, positive with the angle θ from the vertical (not centred). Its gravity moment has the sign that the data give:
m g ℓ > 0 if θ counts from straight down (hanging, as published), −m g ℓ < 0 if it counts from straight up (inverted).
"""


CHOSEN_BY_DATA = "auto"
"""Name of the setting by which the data decide the base of a tissue."""
