"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

from lumbar import __version__
from lumbar.tissue.fmu.agreed import ANNOTATION
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.guards import LARGEST
from lumbar.tissue.fmu.build.meaning import meaning, range_text, sign_text
from lumbar.tissue.fmu.build.sources import c_files, content_token
from lumbar.tissue.fmu.build.units import base_unit

FMI_VERSIONS = ("2.0", "3.0")
AUTHOR = "The lumbar developers"


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU."""

    name: str
    reference: int
    """Value reference, as in ``sampled_force.h``."""
    kind: str
    """``"input"``, ``"output"`` or ``"parameter"``."""
    description: str
    unit: str
    start: float | None
    """None for the output: it is calculated."""
    low: float | None = None
    high: float | None = None
    nominal: float | None = None


def variables(model: ExportModel) -> list[Variable]:
    """Return the variables that a user sees, the same in both versions."""
    x, y, limit = model.input, model.output, model.output_limit
    return [
        Variable(
            x.variable,
            1,
            "input",
            f"Measured {x.quantity}, sampled by the model; it grows into the model",
            x.unit,
            x.offset,
        ),
        Variable(
            y.variable,
            2,
            "output",
            f"{y.quantity.capitalize()} of the model; {_resists(model)}",
            y.unit,
            None,
            -limit,
            limit,
            limit,
        ),
        Variable(
            "gain", 3, "parameter", f"Factor on the model's {y.quantity}", "", 1.0, 0.0, model.gain_limit, 1.0
        ),
        Variable(
            f"{y.variable}_offset",
            4,
            "parameter",
            f"{y.quantity.capitalize()} at rest",
            y.unit,
            y.offset,
            -limit,
            limit,
            limit,
        ),
        Variable(
            f"{y.variable}_limit",
            5,
            "parameter",
            f"Largest magnitude of the {y.quantity}; it can be lowered, not raised",
            y.unit,
            limit,
            0.0,
            limit,
            limit,
        ),
        Variable(
            f"{x.variable}_offset",
            6,
            "parameter",
            f"{x.quantity.capitalize()} at which the model is at rest",
            x.unit,
            x.offset,
        ),
        *_guards(model),
    ]


def _guards(model: ExportModel) -> list[Variable]:
    """Variables of the guards that the model has."""
    guards, y = model.guards, model.output
    rate = Variable(
        f"{y.variable}_rate_limit",
        7,
        "parameter",
        f"Largest change of the {y.quantity} in a second; it can be lowered, not raised",
        f"{y.unit}/s",
        guards.rate_limit,
        0.0,
        guards.rate_limit,
        guards.rate_limit,
    )
    damping = Variable(
        "device_damping",
        8,
        "parameter",
        "Damping that the device surely has at the tool: with less of it the FMU bounds the "
        f"{y.quantity} more; 0 lets none through",
        model.damping_unit,
        guards.device_damping,
        0.0,
        LARGEST,
        1.0,
    )
    reserve = Variable(
        "energy_reserve",
        9,
        "parameter",
        "Most energy that counts as taken in: what is dissipated early is not kept for ever",
        "J",
        guards.energy_reserve,
        0.0,
        LARGEST,
        1.0,
    )
    energy = Variable(
        "energy",
        10,
        "output",
        "Energy that model and device damping have taken in up to the last sample; never negative",
        "J",
        None,
        None,
        None,
        1.0,
    )
    return [rate] * (guards.rate_limit > 0) + [damping, reserve, energy] * guards.passive


def _resists(model: ExportModel) -> str:
    if model.resisting_sign > 0:
        return f"where positive it resists a growing {model.input.quantity}"
    return f"INVERTED: where negative it answers a growing {model.input.quantity}"


def description_text(model: ExportModel, data: str) -> str:
    """One line on the model for the model description."""
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    return (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, "
        f"discrete at {model.sampling_time:g} s. Data: {data}.{stability}"
    )


def guards_text(model: ExportModel) -> list[str]:
    """Say what is done to the force before the device receives it, a sentence or two for each guard."""
    y, guards, texts = model.output, model.guards, []
    way = "positive" if model.resistance > 0 else "negative"
    if guards.contact:
        texts.append(
            f"Contact: the tissue cannot pull; {y.variable} is never on the other side than the {way} one, on which it "
            f"resists a growing {model.input.quantity}. The tissue ends at {model.input.variable}_offset: below it the model "
            "rests, so that it is not felt before it is touched again."
        )
    if guards.rate_limit > 0:
        texts.append(
            f"Rate: {y.variable} begins at 0 and changes by at most {y.variable}_rate_limit in a second, "
            f"{guards.rate_limit * model.sampling_time:g} {y.unit} in a sample."
        )
    if guards.passive:
        texts.append(
            f"Passive: {y.variable} stays within the force at which FMU and a device with the damping device_damping cannot "
            "give out more energy than they took in, whatever is done with the device. It gives way where the model alone "
            f"would feed an oscillation; {way} {y.quantity} counts as resisting. The guarantee needs one communication "
            "step per sample, and a device that displays what is read."
        )
    return texts


def feedthrough_text(model: ExportModel, version: str) -> str:
    """Say what a client sees of the feed-through, by FMI version."""
    if not model.feedthrough:
        return "The model has no feed-through (D = 0): the output of a sample does not depend on its input."
    if model.waits_for_input:
        return _whole_force_late(version)
    if version == "2.0":
        return (
            "Feed-through: an FMI 2.0 client sets the input of a communication point after it has read the "
            "output there, so that it reads C x[k] + D u[k-1], the feed-through one sample late. "
            "The FMI 3.0 FMU with event mode gives C x[k] + D u[k]."
        )
    return (
        "Feed-through: with event mode the input set at a sample instant acts in the output of the same "
        "instant, C x[k] + D u[k]. Without event mode a client reads C x[k] + D u[k-1], one sample late."
    )


def _whole_force_late(version: str) -> str:
    """Say the same for models whose output needs the input of its own sample: velocities come from it."""
    if version == "2.0":
        return (
            "Feed-through: the force of a sample needs its position, which an FMI 2.0 client sets after it has "
            "read the force there; it reads the force of the sample before. "
            "The FMI 3.0 FMU with event mode gives the force of the same sample."
        )
    return (
        "Feed-through: with event mode the position set at a sample instant acts in the force of the same instant. "
        "Without event mode a client reads the force of the sample before."
    )


def _number(value: float) -> str:
    return repr(float(value))


def _attributes(variable: Variable) -> dict[str, str]:
    """Attributes that both versions have under the same names."""
    given = {"min": variable.low, "max": variable.high, "nominal": variable.nominal, "start": variable.start}
    unit = {"unit": variable.unit} if variable.unit else {}
    return {**unit, **{key: _number(value) for key, value in given.items() if value is not None}}


# The input is sampled: importers apply a discrete input at the events that take the samples, a continuous one only
# between them, which gives each sample the position of the one before.
_ROLES = {
    "input": {"causality": "input", "variability": "discrete"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def _units(root: ElementTree.Element, names: list[str]) -> None:
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(names):
        unit = ElementTree.SubElement(units, "Unit", name=name)
        exponents = base_unit(name)
        if exponents is not None:
            ElementTree.SubElement(unit, "BaseUnit", {key: str(value) for key, value in exponents.items()})


def _experiment(root: ElementTree.Element, model: ExportModel) -> None:
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(model.sampling_time)
    )


def _log_categories(root: ElementTree.Element) -> None:
    categories = ElementTree.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        ElementTree.SubElement(categories, "Category", name=name)


def _unknowns(model: ExportModel, numbers: dict[str, int], initial: bool) -> list[dict[str, str]]:
    """Outputs with the variables that they depend on at a sample instant, or at the first one, by their numbers."""
    names = [variable.name for variable in variables(model) if variable.kind == "parameter"]
    if model.feedthrough or (initial and model.starts_at_rest):
        names = [model.input.variable, *names]
    else:
        # Without feed-through the input's offset acts through the states alone.
        names.remove(f"{model.input.variable}_offset")
    dependencies = {model.output.variable: " ".join(str(numbers[name]) for name in names)}
    return [
        # The energy is that of the last sample taken.
        {"number": str(numbers[variable.name]), "dependencies": dependencies.get(variable.name, "")}
        for variable in variables(model)
        if variable.kind == "output"
    ]


def model_description(model: ExportModel, version: str, data: str) -> str:
    """Return modelDescription.xml.

    Parameters
    ----------
    version : str
        One of `FMI_VERSIONS`.
    data : str
        Where the model's data come from.
    """
    return _text(_fmi2(model, data) if version == "2.0" else _fmi3(model, data))


def model_version(model: ExportModel) -> str:
    """Version of the tool and, behind a plus, of the model: another number anywhere makes another one."""
    return f"{__version__}+{content_token(model)[:8]}"


def _root(version: str, model: ExportModel, data: str, **token: str) -> ElementTree.Element:
    return ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            **token,
            "description": " ".join(
                (
                    description_text(model, data),
                    sign_text(model),
                    range_text(model),
                    feedthrough_text(model, version),
                    *guards_text(model),
                )
            ),
            "author": AUTHOR,
            "version": model_version(model),
            "copyright": f"Copyright (c) 2026 {AUTHOR}; the numbers: see license",
            "license": "MIT for the code; the numbers as the data: documentation/licenses/license.txt",
            "generationTool": f"lumbar {__version__}",
            "variableNamingConvention": "flat",
        },
    )


def _fmi2(model: ExportModel, data: str) -> ElementTree.Element:
    root = _root("2.0", model, data, guid=content_token(model))
    simulation = ElementTree.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canHandleVariableCommunicationStepSize": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": "true",
        },
    )
    files = ElementTree.SubElement(simulation, "SourceFiles")
    for name in c_files(model):
        ElementTree.SubElement(files, "File", name=name)
    listed = variables(model)
    _units(root, [variable.unit for variable in listed if variable.unit])
    _log_categories(root)
    _experiment(root, model)
    tool = ElementTree.SubElement(ElementTree.SubElement(root, "VendorAnnotations"), "Tool", name=ANNOTATION)
    # FMI 2.0 wants an element here where FMI 3.0 has text; VDMCheck2 takes neither text nor quotation marks in it.
    told = {key: str(value).lower() for key, value in meaning(model).items()}
    ElementTree.SubElement(tool, "Meaning", told)
    parent = ElementTree.SubElement(root, "ModelVariables")
    for variable in listed:
        scalar = ElementTree.SubElement(
            parent,
            "ScalarVariable",
            {
                "name": variable.name,
                "valueReference": str(variable.reference),
                "description": variable.description,
                **_ROLES[variable.kind],
            },
        )
        ElementTree.SubElement(scalar, "Real", _attributes(variable))
    indices = {variable.name: index for index, variable in enumerate(listed, start=1)}
    structure = ElementTree.SubElement(root, "ModelStructure")
    for name, initial in (("Outputs", False), ("InitialUnknowns", True)):
        parent = ElementTree.SubElement(structure, name)
        for unknown in _unknowns(model, indices, initial):
            ElementTree.SubElement(
                parent, "Unknown", index=unknown["number"], dependencies=unknown["dependencies"]
            )
    return root


def _fmi3(model: ExportModel, data: str) -> ElementTree.Element:
    root = _root("3.0", model, data, instantiationToken=content_token(model))
    ElementTree.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": model.identifier,
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "providesDirectionalDerivatives": "true",
            "canHandleVariableCommunicationStepSize": "true",
            "fixedInternalStepSize": _number(model.sampling_time),
            "mightReturnEarlyFromDoStep": "true",
            "hasEventMode": "true",
        },
    )
    listed = variables(model)
    _units(root, [variable.unit for variable in listed if variable.unit] + ["s"])
    _log_categories(root)
    _experiment(root, model)
    parent = ElementTree.SubElement(root, "ModelVariables")
    ElementTree.SubElement(
        parent,
        "Float64",
        name="time",
        valueReference="0",
        description="Simulation time",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    for variable in listed:
        head = {
            "name": variable.name,
            "valueReference": str(variable.reference),
            "description": variable.description,
        }
        ElementTree.SubElement(parent, "Float64", {**head, **_ROLES[variable.kind], **_attributes(variable)})
    references = {variable.name: variable.reference for variable in listed}
    structure = ElementTree.SubElement(root, "ModelStructure")
    for name, initial in (("Output", False), ("InitialUnknown", True)):
        for unknown in _unknowns(model, references, initial):
            ElementTree.SubElement(
                structure, name, valueReference=unknown["number"], dependencies=unknown["dependencies"]
            )
    annotations = ElementTree.SubElement(root, "Annotations")
    ElementTree.SubElement(annotations, "Annotation", type=ANNOTATION).text = json.dumps(meaning(model))
    return root


def build_description(model: ExportModel) -> str:
    """Return FMI 3.0's sources/buildDescription.xml."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    for name in c_files(model):
        ElementTree.SubElement(files, "SourceFile", name=name)
    return _text(root)


def _text(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
