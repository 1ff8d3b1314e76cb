"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of FMI 3.0."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

from lumbar import __version__
from lumbar.fmu.build.export_model import ExportModel
from lumbar.fmu.build.meaning import meaning, range_text, resisting_sign, sign_text
from lumbar.fmu.build.sources import c_files, content_token

FMI_VERSIONS = ("2.0", "3.0")
AUTHOR = "The lumbar developers"
ANNOTATION = "lumbar"
"""Name of the annotation that holds `lumbar.fmu.build.meaning.meaning`."""

# Exponents of the SI base units and factor, as FMI's BaseUnit wants them.
BASE_UNITS = {
    "m": {"m": 1},
    "mm": {"m": 1, "factor": 1e-3},
    "cm": {"m": 1, "factor": 1e-2},
    "rad": {"rad": 1},
    "deg": {"rad": 1, "factor": 0.017453292519943295},
    "N": {"kg": 1, "m": 1, "s": -2},
    "mN": {"kg": 1, "m": 1, "s": -2, "factor": 1e-3},
    "kN": {"kg": 1, "m": 1, "s": -2, "factor": 1e3},
    "N·m": {"kg": 1, "m": 2, "s": -2},
    "Nm": {"kg": 1, "m": 2, "s": -2},
    "N·mm": {"kg": 1, "m": 2, "s": -2, "factor": 1e-3},
    "s": {"s": 1},
}


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU.

    Attributes
    ----------
    reference : int
        Value reference, as in ``sampled_force.h``.
    kind : str
        ``"input"``, ``"output"`` or ``"parameter"``.
    start : float or None
        None for the output: it is calculated.
    low, high, nominal : float or None
    """

    name: str
    reference: int
    kind: str
    description: str
    unit: str
    start: float | None
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
    ]


def _resists(model: ExportModel) -> str:
    if resisting_sign(model) > 0:
        return f"where positive it resists a growing {model.input.quantity}"
    return f"INVERTED: where negative it answers a growing {model.input.quantity}"


def description_text(model: ExportModel, data: str) -> str:
    """One line on the model for the model description."""
    stability = "" if model.stable else " UNSTABLE: the output runs into its limit."
    return (
        f"{model.input.quantity.capitalize()} to {model.output.quantity} model {model.name}, "
        f"discrete at {model.sampling_time:g} s. Data: {data}.{stability}"
    )


def feedthrough_text(model: ExportModel, version: str) -> str:
    """Say what a client sees of the feed-through, by FMI version."""
    if not model.feedthrough:
        return "The model has no feed-through (D = 0): the output of a sample does not depend on its input."
    if model.dynamics.waits_for_input:
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


_ROLES = {
    "input": {"causality": "input", "variability": "continuous"},
    "output": {"causality": "output", "variability": "discrete", "initial": "calculated"},
    "parameter": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
}


def _units(root: ElementTree.Element, names: list[str]) -> None:
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(names):
        unit = ElementTree.SubElement(units, "Unit", name=name)
        if name in BASE_UNITS:
            ElementTree.SubElement(
                unit, "BaseUnit", {key: str(value) for key, value in BASE_UNITS[name].items()}
            )


def _experiment(root: ElementTree.Element, model: ExportModel) -> None:
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0.0", stopTime="10.0", stepSize=_number(model.sampling_time)
    )


def _log_categories(root: ElementTree.Element) -> None:
    categories = ElementTree.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusError"):
        ElementTree.SubElement(categories, "Category", name=name)


def _dependencies(model: ExportModel, numbers: dict[str, int]) -> str:
    """Numbers of the variables that the output depends on at a sample instant."""
    names = [variable.name for variable in variables(model) if variable.kind == "parameter"]
    if model.feedthrough:
        names = [model.input.variable, *names]
    else:
        # Without feed-through the input's offset acts through the states alone.
        names.remove(f"{model.input.variable}_offset")
    return " ".join(str(numbers[name]) for name in names)


def model_description(model: ExportModel, version: str, data: str) -> str:
    """Return modelDescription.xml.

    Parameters
    ----------
    model : ExportModel
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
    # FMI 2.0 wants an element here where FMI 3.0 has text.
    ElementTree.SubElement(tool, "Meaning").text = meaning(model)
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
    for name in ("Outputs", "InitialUnknowns"):
        ElementTree.SubElement(
            ElementTree.SubElement(structure, name),
            "Unknown",
            index=str(indices[model.output.variable]),
            dependencies=_dependencies(model, indices),
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
    for name in ("Output", "InitialUnknown"):
        ElementTree.SubElement(
            structure,
            name,
            valueReference=str(references[model.output.variable]),
            dependencies=_dependencies(model, references),
        )
    annotations = ElementTree.SubElement(root, "Annotations")
    ElementTree.SubElement(annotations, "Annotation", type=ANNOTATION).text = meaning(model)
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
