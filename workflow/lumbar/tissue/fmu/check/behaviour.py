"""What the library in an FMU does: against its description and reference signals, and against its own sources.

Runs apart (`lumbar.tissue.fmu.check.playing`): a library that is wrong may crash it. That these sources, compiled, do what
FMI asks of them is tested once, not for every file (tests/unit/tissue/fmu/test_runtime_fmu_simulation.py).
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator

import numpy as np
from fmpy.fmi1 import FMICallException

from lumbar.tissue.fmu.check.instance import Instance, Motion, UnzippedFmu, modes, way_in_words
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE, along_axes, slow_push, told_meaning

REFERENCE_TOLERANCE = 1e-9
"""Largest difference from the reference, relative to its largest force: the reference comes from Python, and rounding
differs. Whether an export agrees to the last digits is for `lumbar.tissue.fmu.check.fmu_check`."""
_SAMPLES = 60
"""Of a random motion: longer than the longest moving average."""
_LONG = 10_000
"""Of one in which what comes late shows."""
_FAR = 1e6
"""Times the reference push: any force model that is not bounded by itself is at its limit there."""


def check_start_values(fmu: UnzippedFmu) -> Iterator[str]:
    """Every start value of the description is that of the library."""
    instance = Instance(fmu)
    for name, start in fmu.numbered("start").items():
        found = instance.get(name)
        if found != start:
            yield f"{name}: the library starts with {found!r}; modelDescription.xml says {start!r}"


def check_bounds(fmu: UnzippedFmu) -> Iterator[str]:
    """The library takes a parameter from min to max and nothing beyond."""
    instance = Instance(fmu)
    for end, beyond in (("min", -math.inf), ("max", math.inf)):
        for name, bound in fmu.numbered(end).items():
            if fmu.elements[name][0].causality != "parameter":
                continue
            outside = math.nextafter(bound, beyond)
            if not instance.accepts(name, bound):
                yield f"{name}: the library refuses {bound!r}; modelDescription.xml allows it as {end}"
            if instance.accepts(name, outside):
                yield f"{name}: the library takes {outside!r}; modelDescription.xml ends at {end} {bound!r}"


def check_reference(fmu: UnzippedFmu) -> Iterator[str]:
    """The reference input gives the reference output, with event mode and without."""
    positions = fmu.signal(REFERENCE[0])
    for event_mode in modes(fmu):
        path = WITHOUT_EVENT_MODE if fmu.version == 3 and not event_mode else REFERENCE[1]
        expected, found = fmu.signal(path), Instance(fmu, event_mode).play(positions)
        largest = np.abs(expected).max() or 1.0
        off = np.abs(np.subtract(found, expected)).reshape(len(expected), -1).max(axis=1)
        worst = int(off.argmax())
        if not off[worst] <= REFERENCE_TOLERANCE * largest:
            yield (
                f"{fmu.ports[1]}: {way_in_words(event_mode)} the library gives {found[worst]!r} at sample {worst} of the "
                f"reference; {path} says {expected[worst]!r}"
            )


def check_sign(fmu: UnzippedFmu) -> Iterator[str]:
    """A push is answered by a force of the sign that the description calls resisting."""
    told = told_meaning(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot()) or {}
    inward = Motion(fmu).about_rest(along_axes(slow_push(fmu.sampling_time), fmu.axes))
    start = fmu.numbered("start")
    rest = start.get(f"{fmu.ports[1]}_offset", start.get(f"{fmu.ports[1]}_offset[1]", 0.0))
    forces = np.array(Instance(fmu, modes(fmu)[-1]).play(inward)) - rest
    mean = float((forces * along_axes(1.0, fmu.axes)).mean())
    if mean * told.get("resisting_sign", 0) < 0:
        yield (
            f"{fmu.ports[1]}: the library answers a push with {mean:.3g} on average; by modelDescription.xml the force "
            f"that resists has the sign of {told['resisting_sign']}"
        )


def _guarded(fmu: UnzippedFmu) -> bool:
    """Whether the force is bounded by the forces before it: it is then no longer gain · y + offset."""
    return not {"device_damping", f"{fmu.ports[1]}_rate_limit"}.isdisjoint(fmu.variables)


def check_dependencies(fmu: UnzippedFmu) -> Iterator[str]:
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


def _acting(fmu: UnzippedFmu, event_mode: bool, positions: list) -> set[str]:
    """Names of the variables whose change alters the force of the last of these samples."""
    source, force = fmu.ports
    motion, low, high = Motion(fmu), fmu.numbered("min"), fmu.numbered("max")
    instance = Instance(fmu, event_mode)
    instance.play(positions[:-1])
    instance.reach_sample()
    instance.put(source, positions[-1])
    acting = set()
    for name in fmu.settable:
        before, force_before = instance.get(name), instance.read(force)
        ends = [low.get(name, before - motion.span), high.get(name, before + motion.span)]
        for value in (*ends, before + 0.01 * (ends[1] - before), before + 0.01 * (ends[0] - before)):
            if instance.accepts(name, value) and instance.read(force) != force_before:
                acting.add(fmu.elements[name][0].name)
        instance.set(name, before)
    return acting


CHECKS: tuple[Callable[[UnzippedFmu], Iterator[str]], ...] = (
    check_start_values,
    check_bounds,
    check_reference,
    check_sign,
    check_dependencies,
)


def problems_of(fmu: UnzippedFmu) -> list[str]:
    """Everything that the library does otherwise than the description says; calls that fail count too."""
    found: list[str] = []
    for check in CHECKS:
        subject = check.__name__.removeprefix("check_").replace("_", " ")
        try:
            found += check(fmu)
        except FMICallException as error:
            found.append(f"{error.function}: refused with status {error.status} ({subject}); it must work")
        except OSError as error:
            return [*found, f"the library cannot be loaded: {error}"]
        except Exception as error:  # fmpy raises plain ones, as where an instance is refused
            found.append(f"{subject}: {error}; it must work")
    return list(dict.fromkeys(found))


def first_difference(shipped: UnzippedFmu, built: UnzippedFmu) -> list[str]:
    """Return the first answer in which a library differs from the one that was built of the FMU's own sources."""
    shipped_answers, built_answers = answers(shipped), answers(built)
    for call, found in shipped_answers:
        try:
            _, expected = next(built_answers)
        except Exception as error:  # fmpy raises plain ones, as where an instance is refused
            return [f"{call}: the library answers; built from the FMU's own sources it fails: {error}"]
        for place, value in found.items():
            if repr(value) != repr(expected[place]):  # which tells 0.0 from -0.0, and nan is nan
                return [
                    f"{call}, {place}: the library gives {value!r}; built from the FMU's own sources it gives "
                    f"{expected[place]!r}"
                ]
    return []


def answers(fmu: UnzippedFmu) -> Iterator[tuple[str, dict]]:
    """Yield calls of every kind, in words, and what comes back: values by name or sample, or whether a call is taken."""
    motion, force = Motion(fmu), fmu.ports[1]
    yield "instantiate with another token", _taken(Instance, fmu, token="another FMU's token")
    for parts, begin in ((2, 0.0), (7, 0.0), (1, 1000.0)):
        forces = Instance(fmu, start=begin, parts=parts).play(motion.random(_SAMPLES, 1))
        yield f"{force} in {parts} steps a sample from {begin:g} s on", _by_sample(forces)
    for event_mode in modes(fmu):
        how = way_in_words(event_mode)
        for call, answer in _answers_to_values(fmu, event_mode, motion):
            yield f"{call} {how}", answer
        for call, answer in _answers_to_steps(fmu, event_mode, motion):
            yield f"{call} {how}", answer
        far = motion.about_rest(_FAR * (np.array(motion.random(_SAMPLES, 2)) - motion.rest))
        yield f"{force} far away {how}", _by_sample(Instance(fmu, event_mode).play(far))
        late = Instance(fmu, event_mode).play(motion.random(_LONG, 3))
        yield f"{force} of a long motion {how}", _by_sample(late)


def _by_sample(values: list) -> dict:
    return {f"at sample {number}": value for number, value in enumerate(values)}


def _taken(call: Callable, *arguments, **named_arguments) -> dict[str, bool]:
    """Whether a call is not refused; fmpy raises plain exceptions where an instance is."""
    try:
        call(*arguments, **named_arguments)
    except Exception:
        return {"taken": False}
    return {"taken": True}


def _answers_to_values(fmu: UnzippedFmu, event_mode: bool, motion: Motion) -> Iterator[tuple[str, dict]]:
    """Values taken and refused, and what the outputs and derivatives are after each; saved states; a reset."""
    low, high, start = fmu.numbered("min"), fmu.numbered("max"), fmu.numbered("start")
    outputs = [name for name, (item, _) in fmu.elements.items() if item.causality == "output"]
    instance, fresh = Instance(fmu, event_mode), Instance(fmu, event_mode)

    def state(which: Instance, seed: int) -> dict:
        """Parameters, and the outputs that follow."""
        given = {name: which.get(name) for name in fmu.settable}
        positions = motion.random(_SAMPLES, seed)
        return given | _by_sample([[which.sample(item), *map(which.get, outputs)] for item in positions])

    yield "as it starts", state(instance, 4)
    changed = {name: 0.75 * start[name] + 0.0625 for name in fmu.settable}
    for name in fmu.settable:
        ends = [low.get(name, -motion.span), high.get(name, motion.span)]
        beyond = [math.nextafter(end, sign * math.inf) for end, sign in zip(ends, (-1, 1), strict=True)]
        for value in (*beyond, *ends, math.nan, math.inf, start[name] / 1000, changed[name]):
            yield f"set {name} to {value!r}", {"taken": instance.accepts(name, value)}
            yield f"with {name} set to {value!r}", state(instance, 5)
            slopes = [instance.derivative(part, name) for part in fmu.parts(fmu.ports[1])]
            yield f"derivative by {name}", {"now": slopes}
    saved = instance.save()
    content, samples = instance.serialized(saved)
    content = bytes(content)
    for name in fmu.settable:
        instance.accepts(name, start[name])
    instance.restore(saved)
    yield "in a restored state", state(instance, 6)
    fresh.restore(fresh.deserialized((content, samples)))
    yield "in a state read from bytes", state(fresh, 6)
    for place in (0, len(content) // 2, len(content) - 1):
        damaged = content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]
        yield f"bytes of a state with byte {place} changed", _taken(fresh.deserialized, (damaged, samples))
    instance.reset()
    yield "after a reset", state(instance, 7)
    instance.accepts("gain", 0.5)
    yield "beside a second instance", state(fresh, 8)


def _answers_to_steps(fmu: UnzippedFmu, event_mode: bool, motion: Motion) -> Iterator[tuple[str, dict]]:
    """Steps that FMI refuses, and what follows them."""
    instance, step = Instance(fmu, event_mode), fmu.sampling_time
    positions = motion.random(_SAMPLES, 9)
    instance.play(positions)
    now = (len(positions) - 1) * step
    for begin, length in ((now, -step), (now, 0.0), (now + step / 2, step)):
        taken = instance.steps(begin, length)
        yield f"a step of {length:g} s at {begin:g} s where {now:g} s is reached", {"taken": taken}
    yield "after these steps", _by_sample(instance.play(motion.random(_SAMPLES, 10)))
