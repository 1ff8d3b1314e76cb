"""What the library of an exported FMU does, against its description and reference signals; for tests of the exporter."""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

import numpy as np
from driven_fmu import DrivenFmu, DrivenInstance, Motion, modes, read_annotation

from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE, along_axes, slow_push

REFERENCE_TOLERANCE = 1e-9
"""Largest difference from the reference, relative to its largest force: the reference comes from Python, and rounding differs."""
_SAMPLES = 60
"""Of a random motion: longer than the longest moving average."""


def check_start_values(fmu: DrivenFmu) -> Iterator[str]:
    """Every start value of the description is that of the library."""
    instance = DrivenInstance(fmu)
    for name, start in fmu.numbered("start").items():
        found = instance.get(name)
        if found != start:
            yield f"{name}: the library starts with {found!r}; modelDescription.xml says {start!r}"


def check_bounds(fmu: DrivenFmu) -> Iterator[str]:
    """The library takes a parameter from min to max and nothing beyond."""
    instance = DrivenInstance(fmu)
    for end, beyond in (("min", -math.inf), ("max", math.inf)):
        for name, bound in fmu.numbered(end).items():
            if fmu.elements[name][0].causality != "parameter":
                continue
            outside = math.nextafter(bound, beyond)
            if not instance.accepts(name, bound):
                yield f"{name}: the library refuses {bound!r}; modelDescription.xml allows it as {end}"
            if instance.accepts(name, outside):
                yield f"{name}: the library takes {outside!r}; modelDescription.xml ends at {end} {bound!r}"


def check_reference(fmu: DrivenFmu) -> Iterator[str]:
    """The reference input gives the reference output, with event mode and without."""
    positions = fmu.signal(REFERENCE[0])
    for event_mode in modes(fmu):
        path = WITHOUT_EVENT_MODE if fmu.version == 3 and not event_mode else REFERENCE[1]
        expected, found = fmu.signal(path), DrivenInstance(fmu, event_mode).play(positions)
        largest = np.abs(expected).max() or 1.0
        off = np.abs(np.subtract(found, expected)).reshape(len(expected), -1).max(axis=1)
        worst = int(off.argmax())
        if not off[worst] <= REFERENCE_TOLERANCE * largest:
            yield (
                f"{fmu.ports[1]}: {'with' if event_mode else 'without'} event mode the library gives {found[worst]!r} "
                f"at sample {worst} of the "
                f"reference; {path} says {expected[worst]!r}"
            )


def check_sign(fmu: DrivenFmu) -> Iterator[str]:
    """A push is answered by a force of the sign that the description calls resisting."""
    told = read_annotation(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot()) or {}
    inward = Motion(fmu).about_rest(along_axes(slow_push(fmu.sampling_time), fmu.axes))
    start = fmu.numbered("start")
    rest = start.get(f"{fmu.ports[1]}_offset", start.get(f"{fmu.ports[1]}_offset[1]", 0.0))
    forces = np.array(DrivenInstance(fmu, modes(fmu)[-1]).play(inward)) - rest
    mean = float((forces * along_axes(1.0, fmu.axes)).mean())
    if mean * told.get("resisting_sign", 0) < 0:
        yield (
            f"{fmu.ports[1]}: the library answers a push with {mean:.3g} on average; by modelDescription.xml the force "
            f"that resists has the sign of {told['resisting_sign']}"
        )


def _guarded(fmu: DrivenFmu) -> bool:
    """Whether the force is bounded by the forces before it: it is then no longer gain · y + offset."""
    return not {"device_damping", f"{fmu.ports[1]}_rate_limit"}.isdisjoint(fmu.variables)


def check_dependencies(fmu: DrivenFmu) -> Iterator[str]:
    """What the force depends on at once stands in the model structure; offset and limit, which stand there, do act."""
    force, event_mode, motion = fmu.ports[1], modes(fmu)[-1], Motion(fmu)
    told: set[str] = set()
    found: set[str] = set()
    for unknowns, when, lengths in (
        (fmu.description.initialUnknowns, "at the start", (1,)),
        (fmu.description.outputs, "at once", (7, _SAMPLES)),
    ):
        of_force = {force, *fmu.parts(force)}
        listed = next((item.dependencies for item in unknowns if item.variable.name in of_force), None)
        if listed is None:
            continue  # by the standard it depends on everything
        names = {item.name for item in listed}
        acting = set().union(*(_acting(fmu, event_mode, motion.random(length, 4)) for length in lengths))
        told, found = told | names, found | acting
        for name in sorted(acting - names):
            yield f"{name}: {force} depends on it {when}; the dependencies in modelDescription.xml leave it out"
    if not _guarded(fmu):  # else the forces before may bound it more
        for name in sorted(
            (told - found) & {f"{force}_offset", *fmu.parts(f"{force}_offset"), f"{force}_limit"}
        ):
            yield f"{name}: {force} never depends on it at once; the dependencies in modelDescription.xml list it"


def _acting(fmu: DrivenFmu, event_mode: bool, positions: list) -> set[str]:
    """Names of the variables whose change alters the force of the last of these samples."""
    source, force = fmu.ports
    motion, low, high = Motion(fmu), fmu.numbered("min"), fmu.numbered("max")
    instance = DrivenInstance(fmu, event_mode)
    instance.play(positions[:-1])
    instance.reach_sample()
    instance.write(source, positions[-1])
    acting = set()
    for name in fmu.settable:
        before, force_before = instance.get(name), instance.read(force)
        ends = [low.get(name, before - motion.span), high.get(name, before + motion.span)]
        for value in (*ends, before + 0.01 * (ends[1] - before), before + 0.01 * (ends[0] - before)):
            if instance.accepts(name, value) and instance.read(force) != force_before:
                acting.add(fmu.elements[name][0].name)
        instance.set(name, before)
    return acting


def problems_of(fmu: DrivenFmu) -> list[str]:
    """All problems, a sentence each."""
    checks = (check_start_values, check_bounds, check_reference, check_sign, check_dependencies)
    return [problem for check in checks for problem in check(fmu)]
