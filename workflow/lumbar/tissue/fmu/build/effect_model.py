"""A base model with effects as an FMU runs it: its C functions, its response sample by sample, obstacles to its export."""

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

_MOTION = {
    "first": "bool",
    "time": "double",
    "position": "double",
    "step": "double",
    "velocity": "double",
    "acceleration": "double",
    "path": "double",
}
"""Members of ``motion`` in ``effect_forms.h`` and their types."""
_ALONG = ("position", "step", "velocity", "acceleration")
"""Members with a component along every axis in space, called ``position_x`` …."""
_GIVEN = {
    *_MOTION,
    *(f"{name}_{axis}" for name in _ALONG for axis in AXES),
    "force",
    "memory",
    "next",
    "now",
    "increments",
    "matrix",
    "ring",
}
_KEYWORD = re.compile(
    "auto|bool|break|case|char|const|continue|default|do|double|else|enum|extern|false|float|for|goto|if|inline|int|"
    "long|register|restrict|return|short|signed|sizeof|static|struct|switch|true|typedef|union|unsigned|void|volatile|"
    r"while|(?:shared|begun)_\d+"
)
"""Words of C, and what generated code calls its own."""
_INEXACT = re.compile(
    r"\b((?:a?(?:sin|cos|tan)h?|atan2|cbrt|erfc?|exp2?|expm1|fma|hypot|lgamma|log(?:10|1p|2)?|pow|tgamma)f?)\s*\("
)
"""Calls of C library functions whose last bit differs between platforms; fma is slow where processors have none."""
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


@cache
def _functions() -> dict[str, str]:
    """Functions that a form may call, as declared, by name."""
    text = "".join(map(c_source, ("portable_math.h", "effect_forms.h")))
    declared = re.findall(
        r"^(?:static inline |INLINED )?(?:double|void) (\w+)(\([^)]*\))", text, re.MULTILINE
    )
    return {name: name + arguments for name, arguments in declared}


def step_problems(form: Form) -> list[tuple[str, str]]:
    """Return what keeps a form from becoming a C function: the fault and what is needed."""
    if form.c_step is None and form.channels:
        needed = "export the model with a form that needs position and force alone"
        return [(f"needs {', '.join(form.channels)}, which an FMU does not have", needed)]
    if form.c_step is None:
        needed = (
            'write it as an equation, or give its HandWritten a c_step=CStep("…") (see lumbar.tissue.models.equation), or export '
            "the model without this effect"
        )
        return [("has no C code", needed)]
    problems = []
    names = [item.name for item in (*form.linear, *form.nonlinear)]
    taken, needed = _GIVEN | _functions().keys(), "letters, digits and _, and no word of C or CStep"
    for name in names:
        if not _IDENTIFIER.fullmatch(name) or _KEYWORD.fullmatch(name) or name in taken:
            problems.append((f"parameter {name!r} cannot be a name in C code", needed))
    if len(set(names)) < len(names):
        problems.append((f"parameters {', '.join(names)}", "each needs a different name"))
    if inexact := sorted(set(_INEXACT.findall(_code(form.c_step)))):
        portable = ", ".join(text for name, text in _functions().items() if name.startswith("portable_"))
        fault = f"its C code calls {', '.join(inexact)}"
        problems.append((fault, f"the same on every platform are {portable}"))
    return problems


def _code(step: CStep) -> str:
    """Return statements and value without comments."""
    values = (step.value,) if isinstance(step.value, str) else step.value
    return _COMMENT.sub(" ", "\n".join((step.statements, *values)))


def c_function(
    name: str, form: Form, numbers: dict[str, float], ring: int | None = None, axes: Sequence[str] = ()
) -> str:
    """Return the C function of a form; in space it adds to the forces, or transforms them along every axis.

    Parameters
    ----------
    form : Form
        With a C step that has no problems.
    numbers : dict of str to float
        See `CStep.numbers`.
    ring : int, optional
        Number of the ring that holds the earlier positions, for forms with a history; in space for the first axis.
    axes : sequence of str
        Names of the axes in space.
    """
    value, motion = form.c_step.value, {key: (kind, key) for key, kind in _MOTION.items()}
    # Nothing in the text may end the comment.
    text = f"{form.key}: {form.latex}".replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
    comment = f"/* {' '.join(text.split())} */"

    def along_one_axis(head: str, ring: int | None) -> str:
        return _function(head, "double force", [*_lines(form, numbers, motion, ring), f"return {value};"])

    if not axes:
        return f"{comment}\n{along_one_axis(f'double {name}', ring)}"
    if not isinstance(value, str):
        for key in _ALONG:
            motion |= {f"{key}_{axis}": ("double", f"{key}[{row}]") for row, axis in enumerate(axes)}
        sets = "=" if form.place is Place.OUTPUT else "+="
        body = [
            *_lines(form, numbers, motion),
            *(f"force[{row}] {sets} {each};" for row, each in enumerate(value) if each != f"force[{row}]"),
        ]
        return f"{comment}\n{_function(f'void {name}', 'double force[]', body)}"
    # A form with one value acts along every axis, or along that of its channel, with a memory for each.
    size, parts, calls = form.c_step.memory_size(numbers), [], []
    for row, axis in enumerate(axes):
        if form.channel not in ("", axis):
            continue
        motion |= {key: ("double", f"{key}[{row}]") for key in _ALONG}
        parts.append(along_one_axis(f"double {name}_{axis}", None if ring is None else ring + row))
        memory = f"memory + {row * size}, next + {row * size}"
        calls.append(f"force[{row}] = {name}_{axis}({memory}, now, force[{row}]);")
    return "\n".join([comment, *parts, _function(f"void {name}", "double force[]", calls)])


def _lines(
    form: Form, numbers: dict[str, float], motion: Mapping[str, tuple[str, str]], ring: int | None = None
) -> list[str]:
    """Return declarations of all that a form's code uses, and its statements."""
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
    linear: tuple[float, ...]
    nonlinear: tuple[float, ...]
    numbers: dict[str, float]
    """Numbers that its C code knows by name."""
    memory: int
    """Index in the state at which its memory begins."""
    motion: int
    """Index in the state at which the motion that reaches it begins."""
    channels: int = 1
    """Number of its memories: a form that transforms position or force acts along every axis of space separately."""

    @property
    def memory_end(self) -> int:
        """Index in the state behind its memory."""
        return self.memory + self.channels * self.form.c_step.memory_size(self.numbers)

    @property
    def history(self) -> int:
        """Number of earlier positions that it needs."""
        return self.form.c_step.history_size(self.numbers)


@dataclass(frozen=True)
class EffectModel:
    """A base model with effects."""

    base: Base
    base_numbers: tuple[tuple[float, ...], tuple[float, ...]]
    """Linear and nonlinear parameters of the base."""
    forms: tuple[tuple[Form, tuple[float, ...], tuple[float, ...]], ...]
    """Form, linear and nonlinear parameters of every effect in the order of their addition; all have C steps."""
    sampling_time: float
    """Seconds."""

    c_source = "model_effects.c"
    headers = ("effect_forms.h", "portable_math.h", "portable_math.c")
    waits_for_input = True
    feedthrough = True
    rests_anywhere = True
    delay = 0
    phases = 1
    max_kept = 512

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in space; empty along one axis."""
        return self.base.spatial.axes if self.base.spatial else ()

    @property
    def motion_size(self) -> int:
        """Numbers in the state for position, velocity and path, of the tool and behind every input form."""
        return 2 * (len(self.axes) or 1) + 1

    @cached_property
    def terms(self) -> tuple[PlacedForm, ...]:
        """Input forms, base and parallel forms, output forms: the order of evaluation. The base is a term too."""
        given = [(self.base.form, *self.base_numbers), *self.forms]
        ordered = [item for place in Place for item in given if item[0].place is place]
        # One number counts the samples taken.
        size = self.motion_size
        memory = 1 + size * (1 + sum(form.place is Place.INPUT for form, _, _ in given))
        motion, terms = 1, []
        for form, linear, nonlinear in ordered:
            numbers = form_numbers(form, linear, nonlinear, self.sampling_time)
            reached = 1 if form.place is Place.OUTPUT else motion
            channels = len(self.axes) if self.axes and isinstance(form.c_step.value, str) else 1
            terms.append(PlacedForm(form, linear, nonlinear, numbers, memory, reached, channels))
            memory = terms[-1].memory_end
            motion += size if form.place is Place.INPUT else 0
        return tuple(terms)

    @property
    def structure(self) -> Structure:
        """The model as the catalogue simulates it."""
        return Structure(self.base, tuple(form for form, _, _ in self.forms))

    @property
    def states(self) -> int:
        """Numbers that the model keeps from sample to sample, without earlier positions."""
        return self.terms[-1].memory_end

    @property
    def histories(self) -> tuple[int, ...]:
        """Numbers of earlier positions of each form that needs some, in the order of `terms`."""
        return tuple(term.history for term in self.terms if term.history for _ in range(term.channels))

    @property
    def kept(self) -> int:
        """Numbers that the model keeps from sample to sample."""
        return self.states + sum(self.histories)

    @property
    def largest_pole(self) -> float:
        """Largest pole of a relaxation; 0 without one."""
        return max((abs(term.numbers["pole"]) for term in self.terms if "pole" in term.numbers), default=0.0)

    def _parameters(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear and nonlinear parameters in the order of `structure`."""
        given = [self.base_numbers, *((linear, nonlinear) for _, linear, nonlinear in self.forms)]
        return tuple(np.array([value for item in given for value in item[kind]]) for kind in (0, 1))

    def response(self, inputs: np.ndarray) -> np.ndarray:
        """Return the output by the catalogue's own simulation, on motion as a running loop knows it.

        Parameters
        ----------
        inputs : numpy.ndarray, shape (samples,), in space (samples, axes)
            Deviations from rest; outputs are of this shape.

        Raises
        ------
        NumericalError
            If a force overflows.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = self.structure.simulate(self._motion(inputs), *self._parameters())
        if not np.isfinite(outputs).all():
            raise NumericalError(f"{self.base.name} with effects: the force overflows")
        return outputs.reshape(len(self.axes), -1).T if self.axes else outputs

    def _motion(self, inputs: np.ndarray) -> SampledMotion | SpatialMotion:
        inputs = np.asarray(inputs, dtype=float)
        if not self.axes:
            return SampledMotion.of_positions(inputs, self.sampling_time)
        parts = (SampledMotion.of_positions(along, self.sampling_time) for along in inputs.T)
        return SpatialMotion(tuple(parts), self.axes)

    def late_response(self, inputs: np.ndarray) -> np.ndarray:
        """Return the forces that an FMI 2.0 client reads: that of the sample before, except at the start."""
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
            ring = len(kept) if term.history else None
            functions.append(c_function(name, term.form, term.numbers, ring, self.axes))
            kept += [term.motion + row for row in range(term.channels)] if term.history else []
            behind = f", {term.motion + self.motion_size}" if place is Place.INPUT else ""
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


MAX_MEMORY = 256
"""Numbers that one form may keep from sample to sample, e.g. those of a delay of 255 samples."""


def effect_model(model: FittedModel, sampling_time: float) -> EffectModel:
    """Return a continuous model, a base with effects, as an FMU runs it at this sampling time in seconds.

    Raises
    ------
    InputError
        A base with contact, a model from force to motion, or a form without C code or with code that cannot be used or keeps
        too much: all problems at once.
    """
    problems = Problems(f"model {model.name!r}")
    base = model.structure.base
    # The rotation of the force sensor's axes is not part of the tissue.
    forms = tuple(form for form in model.structure.forms if form.place is not Place.FRAME)
    if base.contact:
        problems.add(
            f"base {base.name}",
            "is one of a tool that leaves the tissue, which FMUs do not support",
            "refine on records in which the tool stays on the tissue, with a base without contact (improvement.base: LE, "
            "Maxwell, KV or KB), and export that model",
        )
        problems.raise_if_any()
    if isinstance(model.structure, ForwardStructure):
        problems.add(
            "structure",
            "it goes from force to motion (improvement.forward), and a haptic device asks for a force",
            "refine on records with the motion as input, and export that model",
        )
        problems.raise_if_any()
    base_numbers, *numbers = (model.values_of(part) for part in (base, *forms))
    for form, values in zip((base.form, *forms), (base_numbers, *numbers), strict=True):
        unusable = step_problems(form)
        for found, needed in unusable:
            problems.add(form.key, found, needed)
        if not unusable:
            _check_numbers(form, values, sampling_time, problems)
    problems.raise_if_any()
    given = tuple((form, *values) for form, values in zip(forms, numbers, strict=True))
    return EffectModel(base, base_numbers, given, sampling_time)


def _check_numbers(form: Form, values: tuple, sampling_time: float, problems: Problems) -> None:
    try:
        numbers = form_numbers(form, *values, sampling_time)
        memory = form.c_step.memory_size(numbers)
        history = form.c_step.history_size(numbers)
    except Exception as error:  # code of the user
        problems.add(form.key, f"constants or memory of its c_step fail ({type(error).__name__}: {error})")
        return
    for name, value in numbers.items():
        if not math.isfinite(value):
            problems.add(form.key, f"{name} becomes {value}", "all numbers of its C code must be finite")
    if not (memory >= 0 and history >= 0 and memory + history <= MAX_MEMORY):
        problems.add(
            form.key,
            f"keeps {memory + history} numbers at {1 / sampling_time:g} Hz",
            f"at most {MAX_MEMORY} fit into an FMU; lower runtime.rate_Hz",
        )
