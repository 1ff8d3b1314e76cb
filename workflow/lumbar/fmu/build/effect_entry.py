"""Reading an entry of models.json that names a base and effects."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lumbar.models.bases import BASES
from lumbar.models.form import Effect, Form
from lumbar.errors import Problems
from lumbar.fmu.build.effect_code import step_problems
from lumbar.fmu.build.effect_model import EffectModel, form_numbers

MAX_MEMORY = 256
"""Numbers that one form may keep from sample to sample, e.g. those of a delay of 255 samples."""


def effect_model(entry: dict, sampling_time: float, catalogue: Mapping[str, Effect]) -> EffectModel:
    """Return the model of an entry of models.json that names a base.

    Parameters
    ----------
    entry : dict
        ``base``, ``linear`` and ``nonlinear`` of the base, and ``effects``: a list of ``effect``, ``form``,
        ``linear``, ``nonlinear``.
    sampling_time : float
        Seconds; that of the FMU.
    catalogue : mapping of str to Effect
        Effects by name.

    Raises
    ------
    InputError
        An unknown base, effect or form, a form without C code or with code that cannot be used, numbers that are
        missing, not finite or, for nonlinear parameters, not above 0: all problems at once.
    """
    problems = Problems(f"model {entry['name']!r}")
    base = BASES.get(entry["base"])
    if base is None:
        problems.add("base", repr(entry["base"]), f"bases are {', '.join(BASES)}")
        problems.raise_if_any()
    given = [(base.form, entry)]
    for effect in entry.get("effects", []):
        form = _form(effect, catalogue, problems)
        if form is not None and any(form.key == earlier.key for earlier, _ in given):
            problems.add("effects", f"{form.key} is there twice", "once is allowed")
        elif form is not None:
            given.append((form, effect))
    numbers = [_numbers(form, item, sampling_time, problems) for form, item in given]
    problems.raise_if_any()
    forms = tuple((form, *values) for (form, _), values in zip(given[1:], numbers[1:], strict=True))
    return EffectModel(base, numbers[0], forms, sampling_time)


def _form(given: dict, catalogue: Mapping[str, Effect], problems: Problems) -> Form | None:
    """Form that an entry names, with C code that can be used."""
    effect = catalogue.get(given["effect"])
    if effect is None:
        allowed = f"there are {', '.join(catalogue)}; effects of your own come from improvement.effect_files"
        problems.add("effects", f"unknown effect {given['effect']!r}", allowed)
        return None
    form = next((form for form in effect.forms if form.name == given["form"]), None)
    if form is None:
        allowed = f"its forms are {', '.join(form.name for form in effect.forms)}"
        problems.add(effect.name, f"unknown form {given['form']!r}", allowed)
        return None
    unusable = step_problems(form)
    for found, needed in unusable:
        problems.add(form.key, found, needed)
    return None if unusable else form


def _numbers(form: Form, given: dict, sampling_time: float, problems: Problems):
    """Linear and nonlinear parameters of a form, both as tuples; None where there is a problem."""
    before = len(problems.entries)
    values = []
    for kind, parameters in (("amplitudes", form.linear), ("shapes", form.nonlinear)):
        values.append(
            _values(form.key, kind, [item.name for item in parameters], given.get(kind, []), problems)
        )
    if len(problems.entries) > before:
        return None
    try:
        numbers = form_numbers(form, *values, sampling_time)
        memory = form.c_step.memory_size(numbers)
    except Exception as error:  # code of the user's own
        problems.add(form.key, f"constants or memory of its c_step fail ({type(error).__name__}: {error})")
        return None
    for name, value in numbers.items():
        if not math.isfinite(value):
            problems.add(form.key, f"{name} becomes {value}", "all numbers of its C code must be finite")
    if not 0 <= memory <= MAX_MEMORY:
        problems.add(
            form.key,
            f"keeps {memory} numbers at {1 / sampling_time:g} Hz",
            f"at most {MAX_MEMORY} fit into an FMU; lower runtime.rate_Hz",
        )
    return tuple(values)


def _values(key: str, kind: str, names: list[str], values, problems: Problems) -> tuple[float, ...]:
    if len(values) != len(names):
        allowed = f"{len(names)} ({', '.join(names)})" if names else "none"
        problems.add(key, f"{len(values)} {kind}", f"needed: {allowed}")
        return ()
    for name, value in zip(names, values, strict=True):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or (kind == "shapes" and not value > 0):
            allowed = "a finite number above 0" if kind == "shapes" else "a finite number"
            problems.add(key, f"{name} is {value!r}", f"{allowed} is needed")
    return tuple(float(value) for value in values if isinstance(value, int | float))
