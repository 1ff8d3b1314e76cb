"""A model structure: a base plus effects in given forms, simulated for given parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.form import Form, LinearParameter, NonlinearParameter, Place
from lumbar.tissue.models.joined_motions import JoinedMotions
from lumbar.tissue.models.motion import Motion


@dataclass(frozen=True)
class Structure:
    """A base and the forms of the effects added to it, in the order in which they were added.

    Linear and nonlinear parameters are ordered base first, then form by form.
    """

    base: Base
    forms: tuple[Form, ...] = ()

    @cached_property
    def linear(self) -> tuple[LinearParameter, ...]:
        """All linear parameters."""
        return self.base.linear + tuple(item for form in self.forms for item in form.linear)

    @cached_property
    def nonlinear(self) -> tuple[NonlinearParameter, ...]:
        """All nonlinear parameters."""
        return self.base.nonlinear + tuple(item for form in self.forms for item in form.nonlinear)

    @cached_property
    def signs(self) -> tuple[int, ...]:
        """Sign constraint of every amplitude."""
        return tuple(item.sign for item in self.linear)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order added."""
        return tuple(form.effect for form in self.forms)

    @property
    def is_linear(self) -> bool:
        """Whether the force is linear in all linear parameters: no form acts on the output."""
        return all(form.place is not Place.OUTPUT for form in self.forms)

    def with_form(self, form: Form) -> Structure:
        """Structure with one form more."""
        return Structure(self.base, (*self.forms, form))

    def without(self, effect: str) -> Structure:
        """Structure without one effect."""
        return Structure(self.base, tuple(form for form in self.forms if form.effect != effect))

    def nonlinear_of(self, nonlinear: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Split all nonlinear parameters into the base's and those of each form by its key."""
        position = len(self.base.nonlinear)
        parts = {}
        for form in self.forms:
            parts[form.key] = nonlinear[position : position + len(form.nonlinear)]
            position += len(form.nonlinear)
        return nonlinear[: len(self.base.nonlinear)], parts

    def design(self, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
        """Force of every amplitude at size 1, before output forms; shape (samples, linear parameters)."""
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.design(part, nonlinear) for part in motion.parts])
        base, parts = self.nonlinear_of(nonlinear)
        seen: Motion = motion
        for form in self.forms:
            if form.place is Place.INPUT:
                seen = self._of(form.remembered_as, form.input_transform, seen, parts[form.key])
        columns = self._of(self.base.name, self.base.columns, seen, base)
        touching = None if self.base.touching is None else self.base.touching(seen, base)
        for form in self.forms:
            if form.place is Place.PARALLEL:
                added = self._of(form.remembered_as, form.columns, seen, parts[form.key])
                columns = [*columns, *(added if touching is None else [touching * item for item in added])]
        return np.array(columns).T

    @staticmethod
    def _of(name: str, function: Callable, motion: Motion, nonlinear: np.ndarray) -> Any:
        return motion.remembered(name, nonlinear, lambda: function(motion, nonlinear))

    def output(self, force: np.ndarray, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
        """Measured force from the force at the tissue, shape (samples,)."""
        if isinstance(motion, JoinedMotions):
            pieces = zip(motion.split(force), motion.parts, strict=True)
            return np.concatenate([self.output(piece, part, nonlinear) for piece, part in pieces])
        _, parts = self.nonlinear_of(nonlinear)
        for form in self.forms:
            if form.place is Place.OUTPUT:
                force = form.output_transform(force, motion, parts[form.key])
        return force

    def simulate(
        self, motion: Motion | JoinedMotions, linear: np.ndarray, nonlinear: np.ndarray
    ) -> np.ndarray:
        """Free-run simulation of the measured force, shape (samples,)."""
        return self.output(self.design(motion, nonlinear) @ linear, motion, nonlinear)


def forces_of(form: Form, motion: Motion | JoinedMotions, nonlinear: np.ndarray) -> np.ndarray:
    """Forces that a parallel form adds, one per amplitude at size 1; shape (samples, linear parameters)."""
    if isinstance(motion, JoinedMotions):
        return np.concatenate([forces_of(form, part, nonlinear) for part in motion.parts])
    return np.stack(form.columns(motion, nonlinear), axis=1)
