"""What an FMU runs of a fitted model with effects, and what keeps it from being exported."""

from __future__ import annotations

import math

from lumbar.base.errors import Problems
from lumbar.tissue.fmu.build.effect_code import step_problems
from lumbar.tissue.fmu.build.effect_model import EffectModel, form_numbers
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.form import Form
from lumbar.tissue.models.forward_structure import ForwardStructure

MAX_MEMORY = 256
"""Numbers that one form may keep from sample to sample, e.g. those of a delay of 255 samples."""


def effect_model(model: FittedModel, sampling_time: float) -> EffectModel:
    """Return a continuous model as an FMU runs it.

    Parameters
    ----------
    model : FittedModel
        A base with effects.
    sampling_time : float
        Seconds; that of the FMU.

    Raises
    ------
    InputError
        A base with contact, a model from force to motion, or a form without C code or with code that cannot be used or keeps
        too much: all problems at once.
    """
    problems = Problems(f"model {model.name!r}")
    base, forms = model.structure.base, model.structure.forms
    if base.contact:
        problems.add(
            f"base {base.name}",
            "is one of a tool that leaves the tissue, which FMUs do not hold",
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
    except Exception as error:  # code of the user's own
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
