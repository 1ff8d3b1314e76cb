"""A base model with effects as what an FMU runs: its response sample by sample, and its C code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.base.errors import NumericalError
from lumbar.tissue.fmu.build.effect_code import c_function
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.sampled_motion import SampledMotion
from lumbar.tissue.models.structure import Structure

MAX_STATES = 512
"""Numbers that a model may keep from sample to sample."""
_MOTION_STATES = 3
"""Position, velocity and path: of the tool and behind every input form."""


@dataclass(frozen=True)
class Term:
    """A form with its numbers."""

    form: Form
    linear: tuple[float, ...]
    nonlinear: tuple[float, ...]
    numbers: dict[str, float]
    """What its C code knows by name."""
    memory: int
    """Where its part of the state begins."""
    motion: int
    """Where the motion that reaches it stands in the state."""

    @property
    def memory_end(self) -> int:
        """Where its part of the state ends."""
        return self.memory + self.form.c_step.memory_size(self.numbers)

    @property
    def history(self) -> int:
        """How many earlier positions it asks for."""
        return self.form.c_step.history_size(self.numbers)


@dataclass(frozen=True)
class EffectModel:
    """A base model with effects."""

    base: Base
    base_numbers: tuple[tuple[float, ...], tuple[float, ...]]
    """Linear and nonlinear parameters of the base."""
    forms: tuple[tuple[Form, tuple[float, ...], tuple[float, ...]], ...]
    """Form, linear and nonlinear parameters of every effect, in the order in which they were added; all with C steps."""
    sampling_time: float
    """Seconds."""

    c_source = "model_effects.c"
    headers = ("effect_forms.h", "portable_math.h", "portable_math.c")
    waits_for_input = True
    feedthrough = True
    rests_anywhere = True
    delay = 0
    phases = 1

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Input forms, base and parallel forms, output forms: the order of evaluation. The base is a term too."""
        given = [(self.base.form, *self.base_numbers), *self.forms]
        ordered = [item for place in Place for item in given if item[0].place is place]
        # One number counts the samples taken.
        memory = 1 + _MOTION_STATES * (1 + sum(form.place is Place.INPUT for form, _, _ in given))
        motion, terms = 1, []
        for form, linear, nonlinear in ordered:
            numbers = form_numbers(form, linear, nonlinear, self.sampling_time)
            reached = 1 if form.place is Place.OUTPUT else motion
            terms.append(Term(form, linear, nonlinear, numbers, memory, reached))
            memory = terms[-1].memory_end
            motion += _MOTION_STATES if form.place is Place.INPUT else 0
        return tuple(terms)

    @property
    def structure(self) -> Structure:
        """The same model as the catalogue simulates it."""
        return Structure(self.base, tuple(form for form, _, _ in self.forms))

    @property
    def states(self) -> int:
        """Numbers that the model carries from sample to sample, earlier positions apart."""
        return self.terms[-1].memory_end

    @property
    def histories(self) -> tuple[int, ...]:
        """How many earlier positions each form that asks for some asks for, in the order of `terms`."""
        return tuple(term.history for term in self.terms if term.history)

    @property
    def kept(self) -> int:
        """Numbers that the model keeps from sample to sample."""
        return self.states + sum(self.histories)

    @property
    def largest_pole(self) -> float:
        """Largest pole of a relaxation; 0 without one."""
        return max((abs(term.numbers["pole"]) for term in self.terms if "pole" in term.numbers), default=0.0)

    def at(self, place: Place) -> tuple[Term, ...]:
        """Terms that act at this place."""
        return tuple(term for term in self.terms if term.form.place is place)

    def problems(self) -> list[tuple[str, str, str]]:
        """What keeps the model from being exported: place, what was found, what is allowed."""
        if self.kept <= MAX_STATES:
            return []
        return [("effects", f"keep {self.kept} numbers", f"at most {MAX_STATES} fit into an FMU")]

    def _parameters(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear and nonlinear parameters in the order of `structure`."""
        given = [self.base_numbers, *((linear, nonlinear) for _, linear, nonlinear in self.forms)]
        return tuple(np.array([value for item in given for value in item[kind]]) for kind in (0, 1))

    def response(self, inputs: np.ndarray) -> np.ndarray:
        """Return the output by the catalogue's own simulation, on motion as a running loop knows it.

        Parameters
        ----------
        inputs : numpy.ndarray, shape (samples,)
            Deviations from rest.

        Raises
        ------
        NumericalError
            If a force overflows.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = self.structure.simulate(self._motion(inputs), *self._parameters())
        if not np.isfinite(outputs).all():
            raise NumericalError(f"{self.base.name} with effects: the force overflows")
        return outputs

    def _motion(self, inputs: np.ndarray) -> SampledMotion:
        return SampledMotion.of_positions(np.asarray(inputs, dtype=float), self.sampling_time)

    def response_from_rest(self, inputs: np.ndarray, late: bool) -> np.ndarray:
        """Return the output from rest at the first input, as all forms begin; shape (samples,)."""
        return self.late_response(inputs) if late else self.response(inputs)

    def late_response(self, inputs: np.ndarray) -> np.ndarray:
        """Return what an FMI 2.0 client reads: the force of the sample before, except at the start."""
        outputs = self.response(inputs)
        return np.concatenate([outputs[:1], outputs[:-1]])

    def rounding_bound(self, inputs: np.ndarray, outputs: np.ndarray) -> float:
        """Error relative to the largest output that rounding alone may cause.

        Elementary functions differ by a few units in the last place and forces may cancel: each may be off by 8
        units of the largest force that a form contributes, and memories carry errors on without amplifying them.
        """
        largest = np.abs(outputs).max()
        linear, nonlinear = self._parameters()
        contributed = np.abs(self.structure.design(self._motion(inputs), nonlinear) * linear).max()
        return float(8 * len(self.terms) * np.finfo(float).eps * contributed / largest) if largest else 0.0

    def c_data(self) -> list[str]:
        """Lines of model_data.h: one C function per form, its numbers in it, and their order."""
        functions, calls, kept = [], [], []
        for index, term in enumerate(self.terms):
            name, place = f"form_{index}", term.form.place
            functions.append(c_function(name, term.form, term.numbers, len(kept) if term.history else None))
            kept += [term.motion] if term.history else []
            behind = f", {term.motion + _MOTION_STATES}" if place is Place.INPUT else ""
            calls.append(f"{place.upper()}_FORM({name}, {term.memory}{behind})")
        return [
            *functions,
            f"#define MODEL_FORMS {' '.join(calls)}",
            f"static const int MODEL_KEPT[] = {{{', '.join(map(str, kept or [0]))}}};",
        ]


def form_numbers(form: Form, linear, nonlinear, sampling_time: float) -> dict[str, float]:
    """Return all numbers that the C code of a form knows, by name."""
    names = (item.name for item in (*form.linear, *form.nonlinear))
    return form.c_step.numbers(dict(zip(names, (*linear, *nonlinear), strict=True)), sampling_time)
