"""A model structure: a base plus effects in given forms, simulated for given parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lumbar.effects.base import Base
from lumbar.effects.effect import Amplitude, Form, Place, Shape
from lumbar.effects.motion import Motion
from lumbar.effects.motions import Motions


@dataclass(frozen=True)
class Structure:
    """A base and the forms of the effects added to it, in the order in which they were added.

    Amplitudes and shapes are ordered base first, then form by form.
    """

    base: Base
    forms: tuple[Form, ...] = ()

    @cached_property
    def amplitudes(self) -> tuple[Amplitude, ...]:
        """All amplitudes."""
        return self.base.amplitudes + tuple(item for form in self.forms for item in form.amplitudes)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """All shapes."""
        return self.base.shapes + tuple(item for form in self.forms for item in form.shapes)

    @cached_property
    def signs(self) -> tuple[int, ...]:
        """Sign constraint of every amplitude."""
        return tuple(item.sign for item in self.amplitudes)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return tuple(form.effect for form in self.forms)

    @property
    def linear(self) -> bool:
        """Whether the force is linear in all amplitudes: no form acts on the output."""
        return all(form.place is not Place.OUTPUT for form in self.forms)

    def with_form(self, form: Form) -> Structure:
        """Structure with one form more."""
        return Structure(self.base, (*self.forms, form))

    def without(self, effect: str) -> Structure:
        """Structure without one effect."""
        return Structure(self.base, tuple(form for form in self.forms if form.effect != effect))

    def shapes_of(self, shapes: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Split all shapes into the base's and those of each form by its key."""
        position = len(self.base.shapes)
        parts = {}
        for form in self.forms:
            parts[form.key] = shapes[position : position + len(form.shapes)]
            position += len(form.shapes)
        return shapes[: len(self.base.shapes)], parts

    def design(self, motion: Motion | Motions, shapes: np.ndarray) -> np.ndarray:
        """Force of every amplitude at size 1, before output forms; shape (samples, amplitudes)."""
        if isinstance(motion, Motions):
            return np.concatenate([self.design(part, shapes) for part in motion.parts])
        base, parts = self.shapes_of(shapes)
        for form in self.forms:
            if form.place is Place.INPUT:
                motion = self._of(form.key, form.input_transform, motion, parts[form.key])
        columns = self._of(self.base.name, self.base.columns, motion, base)
        for form in self.forms:
            if form.place is Place.PARALLEL:
                columns = [*columns, *self._of(form.key, form.columns, motion, parts[form.key])]
        return np.array(columns).T

    @staticmethod
    def _of(name: str, function: Callable, motion: Motion, shapes: np.ndarray) -> Any:
        return motion.remembered(name, shapes, lambda: function(motion, shapes))

    def output(self, force: np.ndarray, motion: Motion | Motions, shapes: np.ndarray) -> np.ndarray:
        """Measured force from the force at the tissue, shape (samples,)."""
        if isinstance(motion, Motions):
            pieces = zip(motion.split(force), motion.parts, strict=True)
            return np.concatenate([self.output(piece, part, shapes) for piece, part in pieces])
        _, parts = self.shapes_of(shapes)
        for form in self.forms:
            if form.place is Place.OUTPUT:
                force = form.output_transform(force, motion, parts[form.key])
        return force

    def simulate(self, motion: Motion | Motions, amplitudes: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Free-run simulation of the measured force, shape (samples,)."""
        return self.output(self.design(motion, shapes) @ amplitudes, motion, shapes)


def forces_of(form: Form, motion: Motion | Motions, shapes: np.ndarray) -> np.ndarray:
    """Forces that a parallel form adds, one per amplitude at size 1; shape (samples, amplitudes)."""
    if isinstance(motion, Motions):
        return np.concatenate([forces_of(form, part, shapes) for part in motion.parts])
    return np.stack(form.columns(motion, shapes), axis=1)
