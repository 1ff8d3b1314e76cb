"""The texts of an FMU: sentences on direction, range, timing and guards, and documentation/index.html."""

import numpy as np

from lumbar import __version__
from lumbar.base.templates import template
from lumbar.tissue.fmu.build.effect_model import PlacedForm
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.sources import AUTHOR, model_version
from lumbar.tissue.fmu.conventions import PUSH_S, slow_push
from lumbar.tissue.models.form import Place


def sign_text(model: ExportModel) -> str:
    """Return a sentence on the sign of the force that resists a growing input."""
    x, y = model.input.variable, model.output.variable
    if model.resisting_sign > 0:
        return (
            f"A growing {x} pushes into the model; a positive {y} resists: on the tool it acts against the direction in which "
            f"{x} grows."
        )
    why = ", as the data it was identified from"
    if model.prescribed:
        why = (
            " on purpose, as the inverted linear model of the thesis (section 3.2.3: an inverted force vector and no dynamic "
            "component, made to feel unlike tissue)"
        )
    return (
        f"INVERTED{why}: a growing {x} gives a negative {y}. Displayed like the {y} of the other models it draws the tool in; "
        "with the other sign it resists."
    )


def range_text(model: ExportModel) -> str:
    """Return a sentence on the motion that the model was fitted to."""
    if model.valid_for is None:
        why = "its file does not say what motion it was fitted to"
        return f"Valid range: not known, {'prescribed, not fitted to data' if model.prescribed else why}."
    return (
        f"Valid range, that of the data it was fitted to: {model.valid_for.describe(model.input.unit)}. Beyond it the "
        f"{model.output.quantity} is a guess."
    )


def feedthrough_text(model: ExportModel, version: str) -> str:
    """Return a sentence on the delay from input to output for a client of this FMI version."""
    if not model.feedthrough:
        return "The model has no feed-through (D = 0): the output of a sample does not depend on its input."
    is_late, waits = version == "2.0", model.dynamics.waits_for_input or model.guards.active
    if waits and is_late:
        return (
            "Feed-through: the force of a sample needs its position, which an FMI 2.0 client sets after it has read the force "
            "there; it reads the force of the sample before. The FMI 3.0 FMU with event mode gives the force of the same sample."
        )
    if waits:
        return (
            "Feed-through: with event mode the position set at a sample instant acts in the force of the same instant. Without "
            "event mode a client reads the force of the sample before."
        )
    if is_late:
        return (
            "Feed-through: an FMI 2.0 client sets the input of a communication point after it has read the output there, so that "
            "it reads C x[k] + D u[k-1], the feed-through one sample late. The FMI 3.0 FMU with event mode gives "
            "C x[k] + D u[k]."
        )
    return (
        "Feed-through: with event mode the input set at a sample instant acts in the output of the same instant, "
        "C x[k] + D u[k]. Without event mode a client reads C x[k] + D u[k-1], one sample late."
    )


def guard_texts(model: ExportModel) -> list[str]:
    """Return a sentence or two for each guard of the force."""
    x, y, guards, texts = model.input, model.output, model.guards, []
    resisting = "positive" if model.resistance > 0 else "negative"
    if model.axes:
        texts.append(
            f"Space: {x.variable} and {y.variable} are vectors along {', '.join(model.axes)}, in FMI 3.0 arrays, in FMI 2.0 "
            f"scalars {x.variable}[1] and so on. Limits are those of the {y.quantity}'s length and keep its direction."
        )
    if guards.contact:
        texts.append(
            f"Contact: the tissue cannot pull; {y.variable} is never on the other side than the {resisting} one, on which it "
            f"resists a growing {x.quantity}. The tissue ends at {x.variable}_offset: below it the model rests, so that it is "
            "not felt before it is touched again."
        )
    if guards.rate_limit > 0:
        texts.append(
            f"Rate: {y.variable} begins at 0 and changes by at most {y.variable}_rate_limit in a second, "
            f"{guards.rate_limit * model.sampling_time:g} {y.unit} in a sample."
        )
    if guards.passive:
        texts.append(
            f"Passive: {y.variable} stays within the force at which FMU and a device with the damping device_damping cannot give "
            "out more energy than they took in, whatever is done with the device. It gives way where the model alone would feed "
            f"an oscillation; {resisting} {y.quantity} counts as resisting. The guarantee needs one communication step per "
            "sample, and a device that displays what is read."
        )
    return texts


def gain_text(model: ExportModel) -> str:
    """Return sentences on changes of the gain, and on the energy that a model releases if it is switched on."""
    x, y = model.input, model.output
    if model.guards.passive:
        return (
            f"Gain, off (0) and on: a change acts at the next sample, and the {y.quantity} stays passive whatever is changed and "
            "when. A rise leaves the energy that counts as taken in the share that the old gain has of the new one: a tissue "
            "that is switched on begins with nothing, and is felt as far as the tool then pushes on."
        )
    change = f"the {y.quantity} steps by the change times the model's."
    if model.guards.rate_limit > 0:
        change = f"the {y.quantity} goes there at {y.variable}_rate_limit."
    # The deepest position of the data, the force that comes with the gain there, and what it gives on the way out, in J.
    example = ""
    deepest = model.valid_for.highest - x.offset if model.valid_for else 0.0
    if model.units.has_energy and not model.axes and deepest > 0:
        path = deepest * slow_push(model.sampling_time)
        forces = model.dynamics.response(np.concatenate([path, path[::-1]]))[len(path) :]
        forces = np.clip(forces, -model.output_limit, model.output_limit)
        steps = np.diff(path[::-1]) * model.units.position
        energy = -model.resistance * model.units.force * float(forces[:-1] @ steps)
        if energy > 0:
            example = (
                f": from 0 to 1 at {model.valid_for.highest:.3g} {x.unit}, the deepest of its data, after a push of {PUSH_S:g} "
                f"s, {forces[0]:.2g} {y.unit} and, on the way out in the same time, {1000 * energy:.2g} mJ"
            )
    return (
        f"Gain, off (0) and on: on a change {change} A rise while the tool is in the tissue can release energy that was not put "
        f"in{example}. Nothing here bounds that, and a slow rise can release as much; an FMU exported with "
        "runtime.device_damping bounds it."
    )


def documentation_html(model: ExportModel, version: str, source_label: str) -> str:
    """Return documentation/index.html, without scripts and external resources."""
    x, output, samples = model.input.variable, model.output.variable, model.moving_average
    pole = f"largest |pole| {model.dynamics.largest_pole:.6g}"
    if isinstance(model.dynamics, LinearModel):
        equations = model.dynamics.equations()
    else:
        equations = [
            f"{term.form.key} ({_ACTS[term.form.place]}): {_numbers(model, term)}"
            for term in model.dynamics.terms
        ]
    # The definition of u[k], and its value before the start.
    average = f"u[k] = {x} − {x}_offset"
    if samples > 1:
        average = (
            f"u[k] is the mean of the last {samples} samples ({1000 * samples * model.sampling_time:g} ms) of "
            f"{x} − {x}_offset, the newest included"
        )
    rest = "has always been where it is" if model.starts_at_rest else "rested at its offset before"
    return template("tissue/fmu/build/documentation.html.jinja").render(
        name=model.name,
        version=version,
        paragraphs=[
            f"Data: {source_label}",
            sign_text(model),
            range_text(model),
            *equations,
            f"{output} = gain · y[k] + {output}_offset, within ±{output}_limit",
            f"{average}; at the first sample the {model.input.quantity} counts as one that {rest}.",
            *guard_texts(model),
            gain_text(model),
            f"Stable: {pole}."
            if model.stable
            else f"Unstable: {pole}; the {model.output.quantity} runs into its limit.",
            f"The model samples its input every {model.sampling_time:g} s from the start time and holds its output in "
            "between. Communication steps of any length are allowed.",
            f"{model.runtime and model.runtime + ' '}The FMU samples its {model.input.quantity} at "
            f"{1 / model.sampling_time:g} Hz by its own clock, whatever the step of the loop; a faster loop feels each "
            f"{model.output.quantity} held, a slower one misses samples. Give it the time that has passed, not one step per "
            "call.",
            feedthrough_text(model, version),
            *model.on_device,
            "modelDescription.xml lists the variables with their units and bounds. An importer that plays "
            "resources/reference_input.csv should read resources/reference_output.csv.",
            f"Made by lumbar {__version__}, model version {model_version(model)}. Author of the code: {AUTHOR}; licence: "
            "MIT (licenses/license.txt). The numbers come from the data named above.",
        ],
    )


_ACTS = {
    Place.INPUT: "the position, before it reaches the tissue",
    Place.PARALLEL: "adds to the force",
    Place.OUTPUT: "the sum of the forces",
}


def _numbers(model: ExportModel, term: PlacedForm) -> str:
    """Return the parameters of a form with units, to six digits; for a base in space its matrices, row by row."""
    base, form = model.dynamics.base, term.form
    values = [(item, f"{term.numbers[item.name]:.6g}") for item in (*form.linear, *form.nonlinear)]
    if base.spatial and form.effect == base.form.effect:
        matrices = base.spatial.matrices(*map(np.array, model.dynamics.base_numbers))
        rows = {
            name: "; ".join(" ".join(f"{value:.6g}" for value in row) for row in matrix)
            for name, matrix in matrices.items()
        }
        linear = [(item, rows[item.name]) for item in base.spatial.base.linear]
        values = [*linear, *values[len(form.linear) :]]
    return ", ".join(
        f"{item.name} = {text} {item.unit.format(x=model.input.unit, y=model.output.unit)}".removesuffix(" 1")
        for item, text in values
    )
