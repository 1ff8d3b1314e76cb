"""Checks of a finished FMU that fmpy's validation leaves out: description, token, bounds, and what it says of itself."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from xml.etree.ElementTree import Element

from lumbar.tissue.fmu.check.lint_files import (
    lint_binaries,
    lint_constants,
    lint_names,
    lint_page,
    lint_references,
    lint_resources,
    lint_sources,
    lint_units,
    ports,
)
from lumbar.tissue.fmu.check.lint_related import lint_related
from lumbar.tissue.fmu.conventions import ANNOTATION, told_meaning
from lumbar.tissue.models.model_data import MotionRange

_ROOT = ("description", "author", "version", "license", "generationTool")
_NUMBERS = ("lowest", "highest", "speed", "lowest_Hz", "highest_Hz")


def lint_meaning(files: Mapping[str, bytes], root: Element, unit: str | None) -> list[str]:
    """Return what is not said, or said in two ways.

    Parameters
    ----------
    root : Element
        Of the model description.
    unit : str or None
        Of the input.
    """
    problems = [f"modelDescription.xml has no {name}" for name in _ROOT if not root.get(name)]
    token = root.get("guid") or root.get("instantiationToken") or ""
    if root.get("version") and not root.get("version", "").endswith(f"+{token[:8]}"):
        problems.append(
            f"version is {root.get('version')}; it must end with +{token[:8]}, as the token begins"
        )
    told = told_meaning(root)
    if told is None:
        return [*problems, f"there is no annotation {ANNOTATION!r}: direction and valid range are not said"]
    if told.get("resisting_sign") not in (1, -1):
        problems.append(
            f"resisting_sign is {told.get('resisting_sign')!r} in the annotation; 1 or -1 is needed"
        )
    output = next((item for item in root.iter() if item.get("causality") == "output"), root)
    if ("where positive it resists" in output.get("description", "")) != (told.get("resisting_sign") == 1):
        problems.append(
            f"{output.get('name')}: its description says {output.get('description')!r}; the annotation has resisting_sign "
            f"{told.get('resisting_sign')!r}"
        )
    texts = {
        "modelDescription.xml": root.get("description", ""),
        "documentation/index.html": unescape(
            files.get("documentation/index.html", b"").decode("utf-8", errors="replace")
        ),
    }
    for place, text in texts.items():
        if ("INVERTED" in text) != (told.get("resisting_sign") == -1):
            said = "calls the force inverted" if "INVERTED" in text else "does not call the force inverted"
            problems.append(
                f"{place} {said}; the annotation has resisting_sign {told.get('resisting_sign')!r}"
            )
    return problems + _lint_range(told, texts, unit)


def _lint_range(told: dict, texts: Mapping[str, str], unit: str | None) -> list[str]:
    if not any(name in told for name in _NUMBERS):
        words = "Valid range: not known"
    else:
        numbers = [told.get(name) for name in _NUMBERS]
        if not all(isinstance(value, int | float) for value in numbers):
            found = ", ".join(f"{name} {told.get(name)!r}" for name in _NUMBERS)
            return [f"the valid range in the annotation is {found}; numbers are needed"]
        motion = MotionRange(*numbers)
        if not (
            motion.lowest <= motion.highest and motion.lowest_Hz <= motion.highest_Hz and motion.speed >= 0
        ):
            return [f"the valid range in the annotation is {motion.in_words(str(unit))}; no motion is"]
        if told.get("unit") != unit:
            return [f"the valid range in the annotation is in {told.get('unit')!r}; the input is in {unit!r}"]
        words = motion.in_words(str(unit))
    return [
        f"{place} does not say {words!r}, as the annotation does"
        for place, text in texts.items()
        if words not in text
    ]


_C_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def lint_fmu(path: Path) -> list[str]:
    """Return the problems found; an empty list for a sound FMU.

    Looks for: a file that is no archive or is damaged; entries that leave the archive or stand twice; a description
    that is no XML or has another version; a model identifier that C does not allow or that the binaries do not have;
    binaries of another platform than their folder's, without FMI's functions or without the token; source files or
    headers that are missing; variables that stand twice, have a start value outside min and max, numbers that are not
    finite, a nominal value that is not positive, a variability that its kind does not have, a unit that is not defined
    or not what its name says, or no place in the model structure; steps and stop times that are not positive;
    capabilities that are not told; numbers that differ between description, sources and documentation; terminals
    of variables that do not exist; no documentation, licence or reference signals; a manifest that names these otherwise.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            files = {name: archive.read(name) for name in names}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError) as error:
        return [f"the archive cannot be read: {error}"]
    problems = lint_names(names)
    if "modelDescription.xml" not in files:
        return [*problems, "there is no modelDescription.xml"]
    for needed in ("documentation/index.html", "documentation/licenses/license.txt"):
        if needed not in files:
            problems.append(f"there is no {needed}")
    try:
        root = ElementTree.fromstring(files["modelDescription.xml"])
    except ElementTree.ParseError as error:
        return [*problems, f"modelDescription.xml is no XML: {error}"]
    version, simulation = root.get("fmiVersion", ""), root.find("CoSimulation")
    if version not in ("2.0", "3.0"):
        problems.append(f"fmiVersion is {version!r}, neither 2.0 nor 3.0")
    if simulation is None:
        return [*problems, "there is no CoSimulation element"]
    identifier = simulation.get("modelIdentifier", "")
    token = root.get("guid" if version == "2.0" else "instantiationToken", "")
    if not _C_IDENTIFIER.fullmatch(identifier):
        problems.append(f"modelIdentifier {identifier!r} is no C identifier")
    problems += lint_binaries(files, identifier, token, version)
    problems += lint_sources(files, simulation, identifier, version)
    steps, unsound = _steps(root, simulation)
    variables = list(_variables(root))
    problems += [*unsound, *_lint_capabilities(simulation, version), *_lint_variables(variables, root)]
    problems += lint_units(root)
    problems += lint_resources(files, variables, version, steps.get("stepSize"))
    if not problems:
        problems += [*lint_references(variables), *lint_constants(files, variables, steps)]
        problems += [*lint_page(files, root, variables), *lint_related(files, steps.get("stepSize"))]
        problems += lint_meaning(files, root, dict(variables)[ports(variables)["input"]].get("unit"))
    return problems


def _numbers(attributes: dict[str, str], keys: tuple[str, ...]) -> tuple[dict[str, float], list[str]]:
    """Return the attributes that are finite numbers, and words on those that are not."""
    given, problems = {}, []
    for key in keys:
        if key in attributes:
            try:
                given[key] = float(attributes[key])
            except ValueError:
                given[key] = math.nan
            if not math.isfinite(given[key]):
                problems.append(f"{key} is {attributes[key]}, no finite number")
                del given[key]
    return given, problems


def _steps(root: ElementTree.Element, simulation: ElementTree.Element) -> tuple[dict[str, float], list[str]]:
    """Return what the description says of the sampling time, and words on steps and times that cannot be."""
    experiment = root.find("DefaultExperiment")
    attributes = {**simulation.attrib, **(experiment.attrib if experiment is not None else {})}
    names = ("stepSize", *(["fixedInternalStepSize"] if root.get("fmiVersion") == "3.0" else []))
    given, problems = _numbers(attributes, (*names, "startTime", "stopTime"))
    problems += [f"there is no {key}" for key in names if key not in attributes]
    problems += [f"{key} is {given[key]:g}, not above 0" for key in names if not given.get(key, 1.0) > 0]
    if not given.get("startTime", 0.0) < given.get("stopTime", math.inf):
        problems.append(f"stopTime {given['stopTime']:g} is not after startTime")
    return {key: given[key] for key in names if given.get(key, 0.0) > 0}, problems


_CAPABILITIES = {
    "2.0": (
        "canHandleVariableCommunicationStepSize",
        "canGetAndSetFMUstate",
        "canSerializeFMUstate",
        "providesDirectionalDerivative",
    ),
    "3.0": (
        "canHandleVariableCommunicationStepSize",
        "canGetAndSetFMUState",
        "canSerializeFMUState",
        "providesDirectionalDerivatives",
        "mightReturnEarlyFromDoStep",
        "hasEventMode",
    ),
}
"""What every library here can do, by version of FMI."""


def _lint_capabilities(simulation: ElementTree.Element, version: str) -> list[str]:
    return [
        f"{name} is {simulation.get(name, 'not there')}; the library can do it: true is needed"
        for name in _CAPABILITIES.get(version, ())
        if simulation.get(name) != "true"
    ]


def _variables(root: ElementTree.Element):
    """Name and attributes of every variable, in both versions' layouts."""
    for element in root.iterfind("ModelVariables/*"):
        typed = element.find("Real") if element.tag == "ScalarVariable" else element
        if typed is not None:
            yield element.get("name", ""), {**element.attrib, **typed.attrib}


def _lint_variables(variables: list[tuple[str, dict]], root: ElementTree.Element) -> list[str]:
    problems = []
    for label, values in (
        ("the name", [name for name, _ in variables]),
        ("the value reference", [attributes.get("valueReference", "") for _, attributes in variables]),
    ):
        problems += [
            f"{label} {value!r} stands twice" for value, count in Counter(values).items() if count > 1
        ]
    causalities = Counter(attributes.get("causality") for _, attributes in variables)
    if causalities["input"] != 1:
        problems.append(f"there are {causalities['input']} inputs; a force model has one")
    if not causalities["output"]:
        problems.append("there is no output; a force model has one")
    units = {unit.get("name") for unit in root.iterfind("UnitDefinitions/Unit")}
    for name, attributes in variables:
        problems += _lint_variable(name, attributes)
        if attributes.get("unit", next(iter(units), None)) not in units:
            problems.append(f"{name}: the unit {attributes['unit']!r} is not defined")
    return problems + _lint_structure(variables, root)


def _lint_structure(variables: list[tuple[str, dict]], root: ElementTree.Element) -> list[str]:
    """Every output stands in the model structure, and nothing there refers to what does not exist."""
    if root.get("fmiVersion") == "2.0":
        known = {str(index): name for index, (name, _) in enumerate(variables, start=1)}
        outputs = [item.get("index") for item in root.iterfind("ModelStructure/Outputs/Unknown")]
    else:
        known = {attributes.get("valueReference"): name for name, attributes in variables}
        outputs = [item.get("valueReference") for item in root.iterfind("ModelStructure/Output")]
    structure = root.find("ModelStructure")
    named = [text for item in structure.iter() for text in item.get("dependencies", "").split()]
    problems = [
        f"the model structure names {number}, which is no variable"
        for number in dict.fromkeys([*outputs, *named])
        if number not in known
    ]
    missing = {name for name, attributes in variables if attributes.get("causality") == "output"}
    missing -= {known.get(number) for number in outputs}
    return problems + [f"the output {name} is not in the model structure" for name in sorted(missing)]


_VARIABILITIES = {
    "input": ("continuous", "discrete"),
    "output": ("discrete",),
    "parameter": ("tunable",),
    "independent": ("continuous",),
}


def _lint_variable(name: str, attributes: dict[str, str]) -> list[str]:
    given, unsound = _numbers(attributes, ("min", "max", "start", "nominal"))
    problems = [f"{name}: {text}" for text in unsound]
    low, high = given.get("min", -math.inf), given.get("max", math.inf)
    if not low <= high:
        problems.append(f"{name}: min {low:g} above max {high:g}")
    elif "start" in given and not low <= given["start"] <= high:
        problems.append(f"{name}: start {given['start']:g} outside [{low:g}, {high:g}]")
    if "start" not in attributes and attributes.get("causality") in ("input", "parameter"):
        problems.append(f"{name}: no start value")
    causality, variability = attributes.get("causality", ""), attributes.get("variability", "")
    if causality in _VARIABILITIES and variability not in _VARIABILITIES[causality]:
        allowed = " or ".join(_VARIABILITIES[causality])
        problems.append(f"{name}: the {causality} has variability {variability!r}; {allowed} is needed")
    if not given.get("nominal", 1.0) > 0:
        problems.append(f"{name}: nominal {given['nominal']:g}, not above 0")
    return problems
