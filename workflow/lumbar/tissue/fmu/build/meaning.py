"""What an FMU's numbers mean: which way is a push, which force resists it, and for which motion the model is known to hold."""

from __future__ import annotations

from dataclasses import asdict

from lumbar.tissue.fmu.build.export_model import ExportModel


def sign_text(model: ExportModel) -> str:
    """One or two sentences on the direction of position and force."""
    x, y = model.input, model.output
    push = f"A growing {x.variable} pushes into the model"
    if model.resisting_sign > 0:
        return (
            f"{push}; a positive {y.variable} resists: on the tool it acts against the direction in which "
            f"{x.variable} grows."
        )
    if model.prescribed:
        why = (
            "INVERTED on purpose, as the inverted linear model of the thesis (section 3.2.3: an inverted force vector and "
            "no dynamic component, made to feel unlike tissue)"
        )
    else:
        why = "INVERTED, as the data it was identified from"
    return (
        f"{why}: a growing {x.variable} gives a negative {y.variable}. Displayed like the {y.variable} of the other models it "
        "draws the tool in; with the other sign it resists."
    )


def range_text(model: ExportModel) -> str:
    """One sentence on the motion that the model was fitted to."""
    if model.valid_for is None:
        known = (
            "prescribed, not fitted to data"
            if model.prescribed
            else "its file does not say what motion it was fitted to"
        )
        return f"Valid range: not known, {known}."
    words = model.valid_for.in_words(model.input.unit)
    return f"Valid range, that of the data it was fitted to: {words}. Beyond it the {model.output.quantity} is a guess."


def rate_text(model: ExportModel) -> str:
    """Sentences on how often to call it."""
    return (
        f"The FMU samples its {model.input.quantity} at {1 / model.sampling_time:g} Hz by its own clock, whatever the step of "
        f"the loop; a faster loop feels each {model.output.quantity} held, a slower one misses samples. "
        "Give it the time that has passed, not one step per call."
    )


def meaning(model: ExportModel) -> dict[str, str | int | float | bool]:
    """Return the same for programs; it stands as an annotation in the model description.

    Without ``unit`` and the numbers of `MotionRange` where the range is not known.
    """
    known = {} if model.valid_for is None else {"unit": model.input.unit, **asdict(model.valid_for)}
    return {
        "push": f"growing {model.input.variable}",
        "resisting_sign": model.resisting_sign,
        "prescribed": model.prescribed,
        **known,
    }
