"""C functions from the C steps of forms, and what keeps a step from becoming one."""

from __future__ import annotations

import re
from functools import cache

from lumbar.tissue.fmu.c import c_source
from lumbar.tissue.models.c_step import CStep
from lumbar.tissue.models.form import Form

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
_GIVEN = {*_MOTION, "force", "memory", "next", "now", "increments", "matrix", "ring"}
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
    """Return what keeps a form from becoming a C function: what was found and what is needed."""
    if form.c_step is None and form.channels:
        return [
            (
                f"needs {', '.join(form.channels)}, which an FMU does not have",
                "export the model with a form that needs position and force alone",
            )
        ]
    if form.c_step is None:
        return [
            (
                "has no C code",
                'write it as an equation, or give its HandWritten a c_step=CStep("…") (lumbar.tissue.models.c_step says what '
                "stands in it), or export the model without this effect",
            )
        ]
    problems = []
    names = [item.name for item in (*form.linear, *form.nonlinear)]
    for name in names:
        if (
            not _IDENTIFIER.fullmatch(name)
            or _KEYWORD.fullmatch(name)
            or name in _GIVEN | _functions().keys()
        ):
            problems.append(
                (
                    f"parameter {name!r} cannot be a name in C code",
                    "letters, digits and _, and no word of C or CStep",
                )
            )
    if len(set(names)) < len(names):
        problems.append((f"parameters {', '.join(names)}", "each needs a name of its own"))
    inexact = sorted(set(_INEXACT.findall(_code(form.c_step))))
    if inexact:
        portable = ", ".join(text for name, text in _functions().items() if name.startswith("portable_"))
        problems.append(
            (f"its C code calls {', '.join(inexact)}", f"the same on every platform are {portable}")
        )
    return problems


def _code(step: CStep) -> str:
    """Statements and value without comments."""
    return _COMMENT.sub(" ", f"{step.statements}\n{step.value}")


def c_function(name: str, form: Form, numbers: dict[str, float], ring: int | None = None) -> str:
    """Return the C function of a form.

    Parameters
    ----------
    name : str
        Of the function, a C identifier.
    form : Form
        With a C step that has no problems.
    numbers : dict of str to float
        What `CStep.numbers` returns.
    ring : int, optional
        Number of the ring that holds the earlier positions, of forms with a history.
    """
    used = set(_WORD.findall(_code(form.c_step)))
    lines = [
        f"const double {key} = {float(value).hex()}; /* {value:.6g} */"
        for key, value in numbers.items()
        if key in used
    ]
    lines += [f"const {kind} {key} = now->{key};" for key, kind in _MOTION.items() if key in used]
    if ring is not None:
        lines.append(f"enum {{ ring = {ring} }};")
    lines += form.c_step.statements.splitlines()
    lines.append(f"return {form.c_step.value};")
    parameters = "const double memory[], double next[], const motion *now, double force"
    body = "\n".join(
        f"    {line}".rstrip() for line in ["(void)memory, (void)next, (void)now, (void)force;", *lines]
    )
    return f"/* {_comment(f'{form.key}: {form.latex}')} */\nstatic double {name}({parameters}) {{\n{body}\n}}"


def _comment(text: str) -> str:
    """Text that cannot end the comment it stands in, on one line."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").split())
