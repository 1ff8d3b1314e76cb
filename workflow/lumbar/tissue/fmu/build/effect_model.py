"""A base model with effects as an FMU runs it: its C functions, its response sample by sample, and checks of its export."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from lumbar.base.errors import NumericalError, Problems
from lumbar.tissue.fmu.c import c_source
from lumbar.tissue.models.bases import Base
from lumbar.tissue.models.equation import CStep
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Form, Place
from lumbar.tissue.models.motion import SampledMotion, SpatialMotion
from lumbar.tissue.models.parameter import AXES
from lumbar.tissue.models.structure import ForwardStructure, Structure

_VECTOR_MEMBERS = ("position", "step", "velocity", "acceleration")
"""Members of ``motion`` in ``effect_forms.h`` with a component along every axis in space, called ``position_x`` …."""
_MOTION_MEMBERS = {"first": "bool", "time": "double", **dict.fromkeys((*_VECTOR_MEMBERS, "path"), "double")}
"""All members of ``motion`` and their types."""
_RESERVED = {
    *_MOTION_MEMBERS,
    *(f"{name}_{axis}" for name in _VECTOR_MEMBERS for axis in AXES),
    *("force", "memory", "next", "now", "increments", "matrix", "ring"),
}
_KEYWORD = re.compile(
    "auto|bool|break|case|char|const|continue|default|do|double|else|enum|extern|false|float|for|goto|if|inline|int|"
    "long|register|restrict|return|short|signed|sizeof|static|struct|switch|true|typedef|union|unsigned|void|volatile|"
    r"while|(?:shared|begun)_\d+"
)
"""Keywords of C, and names in generated code."""
_INEXACT = re.compile(
    r"\b((?:a?(?:sin|cos|tan)h?|atan2|cbrt|erfc?|exp2?|expm1|fma|hypot|lgamma|log(?:10|1p|2)?|pow|tgamma)f?)\s*\("
)
"""Calls of C library functions that differ between platforms in the last bit; fma, which is slow on processors without it."""
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


@cache
def _functions() -> dict[str, str]:
    """Return the declarations of the functions that a form may call, by name."""
    text = "".join(map(c_source, ("portable_math.h", "effect_forms.h")))
    pattern = r"^(?:static inline |INLINED )?(?:double|void) (\w+)(\([^)]*\))"
    return {name: name + arguments for name, arguments in re.findall(pattern, text, re.MULTILINE)}


def _step_problems(form: Form) -> list[tuple[str, str]]:
    """Return the faults of a form that prevent a C function, each with the requirement."""
    if form.c_step is None and form.channels:
        needed = "export the model with a form that needs position and force only"
        return [(f"needs {', '.join(form.channels)}, which an FMU does not have", needed)]
    if form.c_step is None:
        needed = (
            'write it as an equation, or give its HandWritten a c_step=CStep("…") (see lumbar.tissue.models.equation), or export '
            "the model without this effect"
        )
        return [("has no C code", needed)]
    names = [item.name for item in (*form.linear, *form.nonlinear)]
    reserved, needed = (
        _RESERVED | _functions().keys(),
        "letters, digits and _, and no keyword of C or name of CStep",
    )
    problems = [
        (f"parameter {name!r} cannot be a name in C code", needed)
        for name in names
        if not _IDENTIFIER.fullmatch(name) or _KEYWORD.fullmatch(name) or name in reserved
    ]
    if len(set(names)) < len(names):
        problems.append((f"parameters {', '.join(names)}", "each needs a different name"))
    if inexact := sorted(set(_INEXACT.findall(_code(form.c_step)))):
        portable = ", ".join(text for name, text in _functions().items() if name.startswith("portable_"))
        fault = f"its C code calls {', '.join(inexact)}"
        problems.append((fault, f"use functions that are the same on every platform: {portable}"))
    return problems


def _code(step: CStep) -> str:
    """Return statements and value of a form's C code, without comments."""
    values = (step.value,) if isinstance(step.value, str) else step.value
    return _COMMENT.sub(" ", "\n".join((step.statements, *values)))


def _c_function(
    name: str, form: Form, numbers: dict[str, float], ring: int | None, axes: Sequence[str]
) -> str:
    """Return the C function of a form; in space it adds forces along every axis, or transforms the forces.

    `ring` is the number of the ring buffer with the earlier positions, in space the number of the first axis's ring.
    """
    value, motion = form.c_step.value, {key: (kind, key) for key, kind in _MOTION_MEMBERS.items()}
    # Nothing in the text may end the comment.
    text = f"{form.key}: {form.latex}".replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    comment = f"/* {' '.join(text.split())} */"

    def along_one_axis(head: str, ring: int | None) -> str:
        return _function(head, "double force", [*_lines(form, numbers, motion, ring), f"return {value};"])

    if not axes:
        return f"{comment}\n{along_one_axis(f'double {name}', ring)}"
    if not isinstance(value, str):
        for key in _VECTOR_MEMBERS:
            motion |= {f"{key}_{axis}": ("double", f"{key}[{row}]") for row, axis in enumerate(axes)}
        sets = "=" if form.place is Place.OUTPUT else "+="
        body = [
            *_lines(form, numbers, motion),
            *(f"force[{row}] {sets} {each};" for row, each in enumerate(value) if each != f"force[{row}]"),
        ]
        return f"{comment}\n{_function(f'void {name}', 'double force[]', body)}"
    # A form with one value acts along every axis, or along the axis of its channel, with a memory for each.
    size, parts, calls = form.c_step.memory_size(numbers), [], []
    for row, axis in enumerate(axes):
        if form.channel not in ("", axis):
            continue
        motion |= {key: ("double", f"{key}[{row}]") for key in _VECTOR_MEMBERS}
        parts.append(along_one_axis(f"double {name}_{axis}", None if ring is None else ring + row))
        memory = f"memory + {row * size}, next + {row * size}"
        calls.append(f"force[{row}] = {name}_{axis}({memory}, now, force[{row}]);")
    return "\n".join([comment, *parts, _function(f"void {name}", "double force[]", calls)])


def _lines(
    form: Form, numbers: dict[str, float], motion: Mapping[str, tuple[str, str]], ring: int | None = None
) -> list[str]:
    """Return the declarations of the names that a form's code uses, and its statements."""
    used = set(_WORD.findall(_code(form.c_step)))
    lines = [
        f"const double {key} = {float(value).hex()}; /* {value:.6g} */"
        for key, value in numbers.items()
        if key in used
    ]
    lines += [f"const {kind} {key} = now->{member};" for key, (kind, member) in motion.items() if key in used]
    if ring is not None:
        lines.append(f"enum {{ ring = {ring} }};")
    return [*lines, *form.c_step.statements.splitlines()]


def _function(head: str, force: str, lines: list[str]) -> str:
    parameters = f"const double memory[], double next[], const motion *now, {force}"
    body = "\n".join(
        f"    {line}".rstrip() for line in ["(void)memory, (void)next, (void)now, (void)force;", *lines]
    )
    return f"static {head}({parameters}) {{\n{body}\n}}"


@dataclass(frozen=True)
class PlacedForm:
    """A form with its numbers and its place in the state of the model."""

    form: Form
    numbers: dict[str, float]
    """Parameters and constants by their names in the C code."""
    memory: int
    """Index in the state at which the form's memory begins."""
    memory_end: int
    """Index in the state after the end of the form's memory."""
    motion: int
    """Index in the state at which the input motion of the form begins."""
    channels: int
    """Number of separate memories: a form that transforms position or force has one per axis in space."""
    history: int
    """Number of earlier positions that the form needs."""


@dataclass(frozen=True)
class EffectModel:
    """A base model with effects."""

    base: Base
    base_numbers: tuple[tuple[float, ...], tuple[float, ...]]
    """Linear and nonlinear parameters of the base."""
    forms: tuple[tuple[Form, tuple[float, ...], tuple[float, ...]], ...]
    """Form, linear and nonlinear parameters of every effect in the order of their addition; all have C steps."""
    sampling_time: float
    """Sampling time in seconds."""

    c_source = "model_effects.c"
    headers = ("effect_forms.h", "portable_math.h", "portable_math.c")
    waits_for_input = True
    feedthrough = True
    rests_anywhere = True
    delay = 0
    phases = 1
    max_memory = 512

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in space; empty along one axis."""
        return self.base.spatial.axes if self.base.spatial else ()

    @property
    def motion_size(self) -> int:
        """Number of states for position, velocity and path: one set for the tool, and one for each input form."""
        return 2 * (len(self.axes) or 1) + 1

    @cached_property
    def terms(self) -> tuple[PlacedForm, ...]:
        """All terms in the order of evaluation: input forms, the base and parallel forms, output forms."""
        forms = [(self.base.form, *self.base_numbers), *self.forms]
        # The first number of the state counts the samples.
        end = 1 + self.motion_size * (1 + sum(form.place is Place.INPUT for form, _, _ in forms))
        motion, terms = 1, []
        for form, linear, nonlinear in sorted(forms, key=lambda item: list(Place).index(item[0].place)):
            numbers = _form_numbers(form, linear, nonlinear, self.sampling_time)
            channels = len(self.axes) if self.axes and isinstance(form.c_step.value, str) else 1
            begin, end = end, end + channels * form.c_step.memory_size(numbers)
            terms.append(
                PlacedForm(
                    form,
                    numbers,
                    memory=begin,
                    memory_end=end,
                    motion=1 if form.place is Place.OUTPUT else motion,
                    channels=channels,
                    history=form.c_step.history_size(numbers),
                )
            )
            motion += self.motion_size if form.place is Place.INPUT else 0
        return tuple(terms)

    @property
    def structure(self) -> Structure:
        """The model as the catalogue simulates it."""
        return Structure(self.base, tuple(form for form, _, _ in self.forms))

    @property
    def states(self) -> int:
        """Number of states, without earlier positions."""
        return self.terms[-1].memory_end

    @property
    def histories(self) -> tuple[int, ...]:
        """Number of earlier positions of each form with a history, in the order of `terms`."""
        return tuple(term.history for term in self.terms if term.history for _ in range(term.channels))

    @property
    def largest_pole(self) -> float:
        """Largest pole of a relaxation; 0 without relaxations."""
        return max((abs(term.numbers["pole"]) for term in self.terms if "pole" in term.numbers), default=0.0)

    @property
    def parameters(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear and nonlinear parameters in the order of `structure`."""
        parts = [self.base_numbers, *((linear, nonlinear) for _, linear, nonlinear in self.forms)]
        return tuple(np.array([value for part in parts for value in part[kind]]) for kind in (0, 1))

    def motion(self, inputs: np.ndarray) -> SampledMotion | SpatialMotion:
        """Return the motion through positions, (samples,) or in space (samples, axes), with derivatives from past samples."""
        inputs = np.asarray(inputs, dtype=float)
        if not self.axes:
            return SampledMotion.from_positions(inputs, self.sampling_time)
        parts = (SampledMotion.from_positions(along, self.sampling_time) for along in inputs.T)
        return SpatialMotion(tuple(parts), self.axes)

    def response(self, inputs: np.ndarray, late: bool = False) -> np.ndarray:
        """Return the output as the catalogue simulates it, in the shape of `inputs`; see `LinearModel.response`.

        Raises
        ------
        NumericalError
            If a force overflows.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = self.structure.simulate(self.motion(inputs), *self.parameters)
        if not np.isfinite(outputs).all():
            raise NumericalError(f"{self.base.name} with effects: the force overflows")
        outputs = outputs.reshape(len(self.axes), -1).T if self.axes else outputs
        return np.concatenate([outputs[:1], outputs[:-1]]) if late else outputs

    def c_data(self) -> list[str]:
        """Return the lines of model_data.h: one C function per form with its numbers, and their order."""
        functions, calls, stored = [], [], []
        for index, term in enumerate(self.terms):
            name, place = f"form_{index}", term.form.place
            ring = len(stored) if term.history else None
            functions.append(_c_function(name, term.form, term.numbers, ring, self.axes))
            stored += [term.motion + row for row in range(term.channels)] if term.history else []
            behind = f", {term.motion + self.motion_size}" if place is Place.INPUT else ""
            calls.append(f"{place.upper()}_FORM({name}, {term.memory}{behind})")
        return [
            *functions,
            f"#define MODEL_FORMS {' '.join(calls)}",
            f"static const int MODEL_KEPT[] = {{{', '.join(map(str, stored or [0]))}}};",
        ]


def _form_numbers(form: Form, linear, nonlinear, sampling_time: float) -> dict[str, float]:
    """Return the numbers that the C code of a form uses, by name."""
    names = (item.name for item in (*form.linear, *form.nonlinear))
    return form.c_step.numbers(dict(zip(names, (*linear, *nonlinear), strict=True)), sampling_time)


MAX_MEMORY = 256
"""Largest memory of one form, e.g. for a delay of 255 samples."""


def effect_model(model: FittedModel, sampling_time: float) -> EffectModel:
    """Return a base with effects as an FMU runs it at a sampling time in seconds.

    Raises
    ------
    InputError
        If the base has contact, the model goes from force to motion, or a form has no C code, invalid C code or too much
        memory. The message lists all problems.
    """
    problems = Problems(f"model {model.name!r}")
    base = model.structure.base
    # The rotation of the force sensor's axes is not part of the tissue.
    forms = tuple(form for form in model.structure.forms if form.place is not Place.FRAME)
    if base.contact:
        problems.add(
            f"base {base.name}",
            "has contact: the tool leaves the tissue, which FMUs do not support",
            "refine on records in which the tool stays on the tissue, with improvement.base LE, Maxwell, KV or KB",
        )
    if isinstance(model.structure, ForwardStructure):
        problems.add(
            "structure",
            "it goes from force to motion (improvement.forward), but a haptic device needs a force",
            "refine on records with the motion as input, and export that model",
        )
    problems.raise_if_any()
    base_numbers, *numbers = (model.values_of(part) for part in (base, *forms))
    for form, values in zip((base.form, *forms), (base_numbers, *numbers), strict=True):
        if unusable := _step_problems(form):
            for fault, needed in unusable:
                problems.add(form.key, fault, needed)
            continue
        try:
            named = _form_numbers(form, *values, sampling_time)
            memory, history = form.c_step.memory_size(named), form.c_step.history_size(named)
        except Exception as error:  # code of the user
            problems.add(
                form.key, f"constants or memory of its c_step fail ({type(error).__name__}: {error})"
            )
            continue
        for name, value in named.items():
            if not math.isfinite(value):
                problems.add(form.key, f"{name} becomes {value}", "all numbers of its C code must be finite")
        if not (memory >= 0 and history >= 0 and memory + history <= MAX_MEMORY):
            problems.add(
                form.key,
                f"keeps {memory + history} numbers at {1 / sampling_time:g} Hz",
                f"at most {MAX_MEMORY} fit into an FMU; lower runtime.rate_Hz",
            )
    problems.raise_if_any()
    placed = tuple((form, *values) for form, values in zip(forms, numbers, strict=True))
    return EffectModel(base, base_numbers, placed, sampling_time)
