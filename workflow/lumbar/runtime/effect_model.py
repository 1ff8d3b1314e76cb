"""A base model with effects: parsed from models.json, checked, with its C data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lumbar.errors import Problems
from lumbar.runtime.effect_forms import BASES, FORMS, MAX_DELAY, CForm, Place
from lumbar.runtime.effect_steps import simulate
from lumbar.runtime.linear_model import hex_row

MOTION_STATES = 7
"""Samples taken, and position, velocity and path of the tool and at the tissue."""


@dataclass(frozen=True)
class Term:
    """A form with its numbers.

    Attributes
    ----------
    form : CForm
    amplitudes, shapes : tuple of float
    parameters : tuple of float
        What the C function takes.
    memory : int
        Where its part of the state begins.
    """

    form: CForm
    amplitudes: tuple[float, ...]
    shapes: tuple[float, ...]
    parameters: tuple[float, ...]
    memory: int

    @property
    def memory_end(self) -> int:
        """Where its part of the state ends."""
        return self.memory + self.form.memory(self.parameters)


@dataclass(frozen=True)
class EffectModel:
    """A base model with effects.

    Attributes
    ----------
    base : str
        One of `lumbar.runtime.effect_forms.BASES`.
    terms : tuple of Term
        In the order of evaluation: input forms, base and parallel forms, output forms.
    sampling_time : float
        Seconds.
    """

    base: str
    terms: tuple[Term, ...]
    sampling_time: float

    c_files = ("model_effects.c", "effect_forms.c", "portable_math.c")
    headers = ("effect_forms.h", "portable_math.h")
    waits_for_input = True
    feedthrough = True

    @cached_property
    def states(self) -> int:
        """Numbers that the model keeps from sample to sample."""
        return max((term.memory_end for term in self.terms), default=MOTION_STATES)

    @property
    def largest_pole(self) -> float:
        """Largest pole of a relaxation; 0 without one. All forms with memory are bounded by their input."""
        poles = [term.parameters[1] for term in self.terms if term.form.form == "maxwell_branch"]
        return max(poles, default=0.0)

    def at(self, place: Place) -> tuple[Term, ...]:
        """Terms that act at this place."""
        return tuple(term for term in self.terms if term.form.place is place)

    def problems(self) -> list[tuple[str, str, str]]:
        """What keeps the model from being exported; its numbers were checked when it was made."""
        return []

    def response(self, inputs: np.ndarray) -> np.ndarray:
        """Return the output sample by sample in Python, from the first position; shape (samples,)."""
        return simulate(self, inputs)

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
        contributed = max(
            np.abs(EffectModel(self.base, (term,), self.sampling_time).response(inputs)).max()
            for term in self.at(Place.PARALLEL)
        )
        return float(8 * len(self.terms) * np.finfo(float).eps * contributed / largest) if largest else 0.0

    def equations(self) -> list[str]:
        """Return one line per form in plain text, with its numbers to six digits."""
        lines = []
        for term in self.terms:
            names = (*term.form.amplitudes, *term.form.shapes)
            values = ", ".join(
                f"{name} = {value:.6g}"
                for name, value in zip(names, (*term.amplitudes, *term.shapes), strict=True)
            )
            lines.append(f"{term.form.key} ({term.form.place}): {term.form.equation};  {values}")
        return lines

    def c_data(self) -> list[str]:
        """Lines of model_data.h: the forms in order and their numbers as hexadecimal floats."""
        numbers = [value for term in self.terms for value in term.parameters]
        begin = np.cumsum([0, *(len(term.parameters) for term in self.terms)])
        rows = ",\n    ".join(
            f"{{{term.form.function}, MODEL_PARAMETERS + {start}, {term.memory}}}"
            for term, start in zip(self.terms, begin[:-1], strict=True)
        )
        counts = [f"#define MODEL_{place.upper()}_FORMS {len(self.at(place))}" for place in Place]
        return [
            *counts,
            f"static const double MODEL_PARAMETERS[] = {hex_row(numbers)};",
            f"static const term MODEL_TERMS[] = {{\n    {rows}}};",
        ]


def effect_model(entry: dict, sampling_time: float) -> EffectModel:
    """Return the model of an entry of models.json that names a base.

    Parameters
    ----------
    entry : dict
        ``base``, ``amplitudes`` and ``shapes`` of the base, and ``effects``: a list of ``effect``, ``form``,
        ``amplitudes``, ``shapes``.
    sampling_time : float
        Seconds; that of the FMU.

    Raises
    ------
    InputError
        An unknown base, an effect or form without C code, numbers that are missing, not finite or, for shapes,
        not above 0: all problems at once.
    """
    problems = Problems(f"model {entry['name']!r}")
    base = entry["base"]
    if base not in BASES:
        problems.add("base", repr(base), f"bases with C code are {', '.join(BASES)}")
        problems.raise_if_any()
    forms = []
    amplitudes, shapes = list(entry.get("amplitudes", [])), list(entry.get("shapes", []))
    for form in (FORMS[key] for key in BASES[base]):
        forms.append((form, amplitudes[: len(form.amplitudes)], shapes[: len(form.shapes)]))
        amplitudes, shapes = amplitudes[len(form.amplitudes) :], shapes[len(form.shapes) :]
    if amplitudes or shapes:
        problems.add("base", f"{len(amplitudes)} amplitudes and {len(shapes)} shapes too many", f"of {base}")
    for given in entry.get("effects", []):
        key = f"{given['effect']}/{given['form']}"
        if key not in FORMS or given["effect"] == "base":
            problems.add("effects", f"{key} has no C code", f"there is C code for {_known(given['effect'])}")
        else:
            forms.append((FORMS[key], given.get("amplitudes", []), given.get("shapes", [])))
    for form, form_amplitudes, form_shapes in forms:
        _check_numbers(form, form_amplitudes, form_shapes, sampling_time, problems)
    problems.raise_if_any()
    return EffectModel(base, _terms(forms, sampling_time), sampling_time)


def _known(effect: str) -> str:
    forms = [key for key in FORMS if key.startswith(f"{effect}/")]
    return ", ".join(forms) or ", ".join(dict.fromkeys(form.effect for form in FORMS.values()))


def _check_numbers(form: CForm, amplitudes, shapes, sampling_time: float, problems: Problems) -> None:
    for kind, names, values in (("amplitudes", form.amplitudes, amplitudes), ("shapes", form.shapes, shapes)):
        if len(values) != len(names):
            allowed = f"{len(names)} ({', '.join(names)})" if names else "none"
            problems.add(form.key, f"{len(values)} {kind}", f"needed: {allowed}")
            return
        for name, value in zip(names, values, strict=True):
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or (kind == "shapes" and not value > 0):
                allowed = "a finite number above 0" if kind == "shapes" else "a finite number"
                problems.add(form.key, f"{name} is {value!r}", f"{allowed} is needed")
    if form.effect == "delay" and not shapes[0] / sampling_time < MAX_DELAY:
        problems.add(
            form.key,
            f"{shapes[0]} s are {shapes[0] / sampling_time:.0f} samples",
            f"fewer than {MAX_DELAY} fit into an FMU; lower runtime.rate_Hz",
        )


def _terms(forms: list[tuple], sampling_time: float) -> tuple[Term, ...]:
    ordered = [item for place in Place for item in forms if item[0].place is place]
    terms, memory = [], MOTION_STATES
    for form, amplitudes, shapes in ordered:
        amplitudes, shapes = tuple(map(float, amplitudes)), tuple(map(float, shapes))
        term = Term(form, amplitudes, shapes, form.parameters(amplitudes, shapes, sampling_time), memory)
        terms.append(term)
        memory = term.memory_end
    return tuple(terms)
