"""Numbers that an FMU tells more than once: description, sources and documentation must agree."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import unescape
from xml.etree.ElementTree import Element

from lumbar.tissue.fmu.check.lint_files import ports
from lumbar.tissue.fmu.conventions import base_unit

_CONSTANT = re.compile(r"\.(\w+) = ([^,\s}\\]+)")
_ROW = re.compile(r"<tr>((?:<td>[^<]*</td>)+)</tr>")
_CELL = re.compile(r"<td>([^<]*)</td>")


def model_constants(files: Mapping[str, bytes]) -> dict[str, str]:
    """Return the constants of ``sources/model_data.h`` by name, as they are written, and the moving average as ``window``."""
    data, size = (
        files.get(f"sources/{name}", b"").decode("utf-8", errors="replace")
        for name in ("model_data.h", "model_size.h")
    )
    constants = dict(_CONSTANT.findall(data[data.find("MODEL_CONSTANTS") :]))
    window = re.search(r"#define MODEL_WINDOW (\d+)", size + data)
    return {**constants, "window": window[1]} if window else constants


def lint_constants(
    files: Mapping[str, bytes], variables: list[tuple[str, dict]], steps: Mapping[str, float]
) -> list[str]:
    """Return where description and sources say different numbers.

    Parameters
    ----------
    variables : list of tuple
        Name and attributes.
    steps : mapping of str to float
        Numbers of the description that are the sampling time, by attribute.
    """
    constants, given = model_constants(files), dict(variables)
    source, force = (ports(variables).get(causality, "") for causality in ("input", "output"))
    told = [(key, value, "sampling_time") for key, value in steps.items()]
    for name, attribute, constant, sign in (
        (source, "start", "input_offset", 1),
        (f"{source}_offset", "start", "input_offset", 1),
        (f"{force}_offset", "start", "output_offset", 1),
        (f"{force}_limit", "start", "output_limit", 1),
        (f"{force}_limit", "max", "output_limit", 1),
        (force, "max", "output_limit", 1),
        (force, "min", "output_limit", -1),
        ("gain", "max", "gain_limit", 1),
    ):
        try:
            value = sign * float(given.get(name, {})[attribute])
        except (KeyError, ValueError):
            continue  # told by the lint of the variables
        told.append((f"{name}: {attribute}", value, constant))
    problems = []
    for place, value, constant in told:
        try:
            expected = float.fromhex(constants[constant])
        except (KeyError, ValueError):
            problems.append(f"sources/model_data.h has no number {constant}")
            continue
        if value != expected:
            problems.append(f"{place} is {value!r}; the sources have {constant} {expected!r}")
    return list(dict.fromkeys(problems))


def lint_units(root: Element) -> list[str]:
    """Return the units that are defined otherwise than by their names."""
    problems = []
    for unit in root.iterfind("UnitDefinitions/Unit"):
        name, base = unit.get("name", ""), unit.find("BaseUnit")
        known = base_unit(name)
        if known is None:
            continue
        try:
            found = {key: float(value) for key, value in base.attrib.items()} if base is not None else {}
        except ValueError:
            found = {}
        if found != known:
            problems.append(f"the unit {name} is defined as {_words(found)}; it is {_words(known)}")
    return problems


def _words(base: Mapping[str, float]) -> str:
    return " ".join(f"{key}={value:g}" for key, value in base.items()) or "nothing"


def lint_references(variables: list[tuple[str, dict]]) -> list[str]:
    """Return names that do not stand at their place in the library: the enumeration of ``sources/sampled_force.h``."""
    source, force = (ports(variables).get(causality, "") for causality in ("input", "output"))
    guards = (f"{force}_rate_limit", "device_damping", "energy_reserve", "energy")
    places = ("time", source, force, "gain", f"{force}_offset", f"{force}_limit", f"{source}_offset", *guards)
    expected = {name: str(place) for place, name in enumerate(places)}
    return [
        f"{name}: its value reference is {attributes.get('valueReference')}; in the sources it is {expected[name]}"
        for name, attributes in variables
        if name in expected and attributes.get("valueReference") != expected[name]
    ]


def lint_page(files: Mapping[str, bytes], root: Element, variables: list[tuple[str, dict]]) -> list[str]:
    """Return where ``documentation/index.html`` tells other numbers than the description and the sources."""
    page = files.get("documentation/index.html", b"").decode("utf-8", errors="replace")
    if not page:
        return []  # told as a missing file
    title = f"<title>{root.get('modelName')} (FMI {root.get('fmiVersion')})</title>"
    if title not in unescape(page):
        return [f"documentation/index.html is another FMU's; {title} is needed"]
    problems = []
    rows = {cells[0]: cells[1:6] for cells in map(_CELL.findall, _ROW.findall(page))}
    for name, attributes in variables:
        if attributes.get("causality") == "independent":
            continue
        expected = [attributes.get("causality", ""), attributes.get("unit", "1")]
        expected += [
            f"{float(attributes[key]):g}" if key in attributes else "–" for key in ("start", "min", "max")
        ]
        if rows.get(name) != expected:
            found = ", ".join(rows.get(name, [])) or "nothing"
            problems.append(
                f"{name}: documentation/index.html has {found}; modelDescription.xml has {', '.join(expected)} "
                "(kind, unit, start, min, max)"
            )
    samples = re.search(r"mean of the last (\d+) samples", page)
    window = samples[1] if samples else "1"
    sizes = files.get("sources/model_size.h", b"").decode("utf-8", errors="replace")
    sized = re.search(r"#define MODEL_WINDOW (\d+)", sizes)
    if sized and window != sized[1]:
        problems.append(
            f"documentation/index.html says a moving average of {window} samples; the sources have {sized[1]}"
        )
    step = re.search(r"samples its input every ([0-9.e+-]+) s", page)
    told = root.find("DefaultExperiment")
    expected_step = told.get("stepSize", "") if told is not None else ""
    if step is None or float(step[1]) != float(f"{float(expected_step or 0):g}"):
        problems.append(
            f"documentation/index.html says a sampling time of {step[1] if step else 'nothing'} s; it is {expected_step} s"
        )
    return problems
