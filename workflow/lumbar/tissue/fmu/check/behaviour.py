"""What the library in an FMU does, against what its description and its reference signals say.

Runs apart (``python -m lumbar.tissue.fmu.check.behaviour``, see `lumbar.tissue.fmu.check.playing`): a library that is
wrong may crash it.
"""

from __future__ import annotations

import faulthandler
import json
import math
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path

from lumbar.tissue.fmu.check import calls
from lumbar.tissue.fmu.check.instance import Instance, UnzippedFmu
from lumbar.tissue.fmu.check.motion import Motion, modes, named
from lumbar.tissue.fmu.conventions import REFERENCE, WITHOUT_EVENT_MODE, slow_push, told_meaning

SECONDS = 120
"""A library that plays for longer hangs: it takes a fraction of one."""
REFERENCE_TOLERANCE = 1e-9
"""Largest difference from the reference, relative to its largest force: the reference comes from Python, and rounding
differs. Whether an export agrees to the last digits is for `lumbar.tissue.fmu.check.fmu_check`."""
_ROUNDING = 1e-9
"""What two ways of computing the same force may differ by, relative to its limit."""
_SAMPLES = 60
"""Of a random motion: longer than the longest moving average."""
_COMPARED = 400
"""Samples that two libraries are compared on, about each of two sets of parameters."""
_LONG = 10_000
"""Further ones: what comes late shows."""
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
            if fmu.variables[name].causality != "parameter":
                continue
            outside = math.nextafter(bound, beyond)
            if not instance.accepts(name, bound):
                yield f"{name}: the library refuses {bound!r}; modelDescription.xml allows it as {end}"
            if instance.accepts(name, outside):
                yield f"{name}: the library takes {outside!r}; modelDescription.xml ends at {end} {bound!r}"


def check_token(fmu: UnzippedFmu) -> Iterator[str]:
    """Another token is refused."""
    try:
        Instance(fmu, token="another FMU's token")
    except Exception:
        return
    yield "the library takes any token; it must refuse all but that of modelDescription.xml"


def check_reference(fmu: UnzippedFmu) -> Iterator[str]:
    """The reference input gives the reference output, with event mode and without."""
    positions = fmu.signal(REFERENCE[0])
    for event_mode in modes(fmu):
        path = WITHOUT_EVENT_MODE if fmu.version == 3 and not event_mode else REFERENCE[1]
        expected, found = fmu.signal(path), Instance(fmu, event_mode).play(positions)
        largest = max(map(abs, expected)) or 1.0
        worst = max(range(len(expected)), key=lambda k: abs(found[k] - expected[k]))
        if not abs(found[worst] - expected[worst]) <= REFERENCE_TOLERANCE * largest:
            yield (
                f"{fmu.ports[1]}: {named(event_mode)} the library gives {found[worst]!r} at sample {worst} of the "
                f"reference; {path} says {expected[worst]!r}"
            )


def _inward(fmu: UnzippedFmu) -> list[float]:
    """The reference push up to its deepest point."""
    push = Motion(fmu).push
    return push[: push.index(max(push)) + 1]


def check_sign(fmu: UnzippedFmu) -> Iterator[str]:
    """A push is answered by a force of the sign that the description calls resisting."""
    told = told_meaning(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot()) or {}
    inward = [Motion(fmu).rest + position for position in slow_push(fmu.sampling_time).tolist()]
    rest = fmu.numbered("start").get(f"{fmu.ports[1]}_offset", 0.0)
    mean = sum(force - rest for force in Instance(fmu, modes(fmu)[-1]).play(inward)) / len(inward)
    if mean * told.get("resisting_sign", 0) < 0:
        yield (
            f"{fmu.ports[1]}: the library answers a push with {mean:.3g} on average; by modelDescription.xml the force "
            f"that resists has the sign of {told['resisting_sign']}"
        )


def check_sampling(fmu: UnzippedFmu) -> Iterator[str]:
    """The next event is one step of the description away."""
    if True not in modes(fmu):
        return
    instance = Instance(fmu, event_mode=True)
    instance.sample(Motion(fmu).rest)
    if abs(instance.next_event - fmu.sampling_time) > 1e-9 * fmu.sampling_time:
        yield (
            f"fixedInternalStepSize: the library takes its next sample after {instance.next_event!r} s; "
            f"modelDescription.xml says {fmu.sampling_time!r}"
        )


def check_limits(fmu: UnzippedFmu) -> Iterator[str]:
    """However far the position, gain and offset go, the force stays within its bounds and those set."""
    motion, force = Motion(fmu), fmu.ports[1]
    low, high = fmu.numbered("min").get(force, -math.inf), fmu.numbered("max").get(force, math.inf)
    limit = f"{force}_limit"
    far = [motion.rest + _FAR * (item - motion.rest) for item in motion.random(_SAMPLES, 1)]
    for event_mode in modes(fmu):
        for lowered in (None, high / 4):
            instance = Instance(fmu, event_mode)
            if lowered is not None:
                instance.accepts(limit, lowered)
            bounds = (low, high) if lowered is None else (-lowered, lowered)
            forces = instance.play(far)
            worst = max(forces, key=abs)
            if not (bounds[0] <= min(forces) and max(forces) <= bounds[1]):
                said = (
                    "modelDescription.xml says" if lowered is None else f"{limit} set to {lowered:g} asks for"
                )
                yield (
                    f"{force}: the library gives {worst!r} {named(event_mode)} at positions far away; {said} "
                    f"{bounds[0]:g} to {bounds[1]:g}"
                )
                break


def check_not_finite(fmu: UnzippedFmu) -> Iterator[str]:
    """A position that is no finite number is not taken: the last finite one stays, and so the force is finite."""
    motion, (position, force) = Motion(fmu), fmu.ports
    for value in (math.nan, math.inf):
        instance = Instance(fmu)
        instance.play(motion.random(5, 2))
        before = instance.get(position)
        instance.accepts(position, value)
        if instance.get(position) != before:
            yield f"{position}: the library keeps {instance.get(position)} when it is set to {value}; {before!r} must stay"
        if not all(map(math.isfinite, instance.play([value, *motion.random(5, 3)]))):
            yield f"{force}: it is no finite number after a position of {value}; the last finite position must stay"


def _forces(fmu: UnzippedFmu, event_mode: bool, positions: list[float], **parameters: float) -> list[float]:
    instance = Instance(fmu, event_mode)
    for name, value in parameters.items():
        instance.set(name, value)
    return instance.play(positions)


def _guarded(fmu: UnzippedFmu) -> bool:
    """Whether the force is bounded by the forces before it: it is then no longer gain · y + offset."""
    return not {"device_damping", f"{fmu.ports[1]}_rate_limit"}.isdisjoint(fmu.variables)


def check_roles(fmu: UnzippedFmu) -> Iterator[str]:
    """Parameters do what their names say: the gain multiplies, one offset adds, the other shifts the position."""
    position, force = fmu.ports
    motion, start, event_mode = Motion(fmu), fmu.numbered("start"), modes(fmu)[-1]
    offset, shift = f"{force}_offset", f"{position}_offset"
    missing = [name for name in ("gain", offset, f"{force}_limit", shift) if name not in fmu.settable]
    for name in missing:
        yield f"{name}: there is no tunable parameter of this name; an FMU of this kind has one"
    if missing or _guarded(fmu):
        return
    push = motion.push[: len(motion.push) // 2]
    limit, plain = start[f"{force}_limit"], _forces(fmu, event_mode, push)
    added, moved = math.copysign(limit / 16, max(plain, key=abs)), motion.span / 4
    offsets = [value - start[offset] for value in plain]
    for name, expected, found in (
        (
            "gain",
            [start[offset] + value / 2 for value in offsets],
            _forces(fmu, event_mode, push, gain=start["gain"] / 2),
        ),
        (
            offset,
            [value + added for value in plain],
            _forces(fmu, event_mode, push, **{offset: start[offset] + added}),
        ),
        (
            shift,
            plain,
            _forces(fmu, event_mode, [item + moved for item in push], **{shift: start[shift] + moved}),
        ),
    ):
        # Where a tissue cannot pull, the force is 0 whatever is added to it.
        pairs = [
            (wanted, got)
            for value, wanted, got in zip(plain, expected, found, strict=True)
            if value != 0.0 and abs(wanted) < 0.999 * limit
        ]
        wanted, got = max(pairs, key=lambda pair: abs(pair[0] - pair[1]), default=(0.0, 0.0))
        if not abs(wanted - got) <= _ROUNDING * limit:
            yield f"{name}: with another value the library gives {got:.9g}; what its name says gives {wanted:.9g}"


def check_dependencies(fmu: UnzippedFmu) -> Iterator[str]:
    """What the force depends on at once stands in the model structure; offset and limit, which stand there, do act."""
    force, event_mode, motion = fmu.ports[1], modes(fmu)[-1], Motion(fmu)
    told: set[str] = set()
    found: set[str] = set()
    for unknowns, when, lengths in (
        (fmu.description.initialUnknowns, "at the start", (1,)),
        (fmu.description.outputs, "at once", (7, _SAMPLES)),
    ):
        listed = next((item.dependencies for item in unknowns if item.variable.name == force), None)
        if listed is None:
            continue  # by the standard it depends on everything
        names = {item.name for item in listed}
        acting = set().union(*(_acting(fmu, event_mode, motion.random(length, 4)) for length in lengths))
        told, found = told | names, found | acting
        for name in sorted(acting - names):
            yield f"{name}: {force} depends on it {when}; the dependencies in modelDescription.xml leave it out"
    if not _guarded(fmu):  # else the forces before may bound it more
        for name in sorted((told - found) & {f"{force}_offset", f"{force}_limit"}):
            yield f"{name}: {force} never depends on it at once; the dependencies in modelDescription.xml list it"


def _acting(fmu: UnzippedFmu, event_mode: bool, positions: list[float]) -> set[str]:
    """Names of the variables whose change alters the force of the last of these samples."""
    source, force = fmu.ports
    motion, low, high = Motion(fmu), fmu.numbered("min"), fmu.numbered("max")
    instance = Instance(fmu, event_mode)
    instance.play(positions[:-1])
    instance.reach_sample()
    instance.set(source, positions[-1])
    acting = set()
    for name in fmu.settable:
        before, force_before = instance.get(name), instance.get(force)
        ends = [low.get(name, before - motion.span), high.get(name, before + motion.span)]
        for value in (*ends, before + 0.01 * (ends[1] - before), before + 0.01 * (ends[0] - before)):
            if instance.accepts(name, value) and instance.get(force) != force_before:
                acting.add(name)
        instance.set(name, before)
    return acting


def check_derivatives(fmu: UnzippedFmu) -> Iterator[str]:
    """The derivatives by gain and offset are those of gain · y + offset."""
    force = fmu.ports[1]
    if _guarded(fmu):
        return
    instance, start = Instance(fmu), fmu.numbered("start")
    instance.play(_inward(fmu))
    read = instance.get(force)
    offset = f"{force}_offset"
    unknown = [fmu.variables[force].valueReference]
    for name, expected in (("gain", (read - start[offset]) / start["gain"]), (offset, 1.0)):
        known = [fmu.variables[name].valueReference]
        found = instance.slave.getDirectionalDerivative(unknown, known, [1.0])[0]
        if not abs(found - expected) <= _ROUNDING * max(1.0, abs(expected)):
            yield f"{name}: the library's derivative of {force} by it is {found:.9g}; it must be {expected:.9g}"


def check_reset(fmu: UnzippedFmu) -> Iterator[str]:
    """After a reset the library is as new: parameters and forces."""
    motion, start = Motion(fmu), fmu.numbered("start")
    for event_mode in modes(fmu):
        instance = Instance(fmu, event_mode)
        positions = motion.random(_SAMPLES, 5)
        first = instance.play(positions)
        for name in fmu.settable:
            instance.accepts(name, start[name] / 2 + 0.125)
        instance.play(positions)
        instance.reset()
        for name in fmu.settable:
            if instance.get(name) != start[name]:
                yield f"{name}: it is {instance.get(name)!r} after a reset; it must start with {start[name]!r}"
        again = instance.play(positions)
        if again != first:
            words = _first_difference(again, first, "after a reset", "a new instance gives")
            yield f"{fmu.ports[1]}: {named(event_mode)} {words}"


def _first_difference(found: list[float], expected: list[float], when: str, other: str) -> str:
    at = next(k for k, pair in enumerate(zip(found, expected, strict=True)) if pair[0] != pair[1])
    return f"it is {found[at]!r} {when}, at sample {at}; {other} {expected[at]!r}"


def check_saved_states(fmu: UnzippedFmu) -> Iterator[str]:
    """A state that is restored, or read from bytes in another instance, continues bit for bit."""
    motion, force, start = Motion(fmu), fmu.ports[1], fmu.numbered("start")
    positions, more = motion.random(_SAMPLES, 6), motion.random(_SAMPLES, 7)
    for event_mode in modes(fmu):
        instance, fresh = Instance(fmu, event_mode), Instance(fmu, event_mode)
        changed = {name: start[name] * 0.75 + 0.0625 for name in fmu.settable if name != fmu.ports[0]}
        changed = {name: value for name, value in changed.items() if instance.accepts(name, value)}
        instance.play(positions)
        saved = instance.save()
        content = instance.serialized(saved)
        expected = instance.play(more)
        for name in changed:
            instance.accepts(name, start[name])
        instance.restore(saved)
        fresh.play(positions[:1])
        fresh.restore(fresh.deserialized(content))
        for other, when in ((instance, "in a restored state"), (fresh, "in a state read from bytes")):
            for name, value in changed.items():
                if other.get(name) != value:
                    yield f"{name}: it is {other.get(name)!r} {when}; {value!r} was saved"
            found = other.play(more)
            if found != expected:
                yield f"{force}: {named(event_mode)} {_first_difference(found, expected, when, 'without saving')}"


def check_instances(fmu: UnzippedFmu) -> Iterator[str]:
    """Two instances side by side do not disturb each other."""
    motion = Motion(fmu)
    one, two = motion.random(_SAMPLES, 8), motion.random(_SAMPLES, 9)
    alone = Instance(fmu).play(one)
    first, second = Instance(fmu), Instance(fmu)
    beside = []
    for positions in zip(one, two, strict=True):
        beside.append(first.sample(positions[0]))
        second.accepts("gain", 0.5)
        second.sample(positions[1])
    if beside != alone:
        yield f"{fmu.ports[1]}: {_first_difference(beside, alone, 'beside a second instance', 'alone it is')}"


CHECKS: tuple[Callable[[UnzippedFmu], Iterator[str]], ...] = (
    check_start_values,
    check_bounds,
    check_token,
    check_sampling,
    check_reference,
    check_sign,
    check_limits,
    check_not_finite,
    check_roles,
    check_dependencies,
    check_derivatives,
    check_reset,
    check_saved_states,
    check_instances,
    calls.check_steps,
    calls.check_refused_steps,
    calls.check_damaged_bytes,
    calls.check_slope,
    calls.check_energy,
)


def problems_of(fmu: UnzippedFmu) -> list[str]:
    """Everything that the library does otherwise than the description says; calls that fail count too."""
    from fmpy.fmi1 import FMICallException

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


def compared(shipped: UnzippedFmu, built: UnzippedFmu) -> list[str]:
    """Forces of two libraries on the same motion, bit for bit, with other parameters in the second half."""
    motion, start = Motion(shipped), shipped.numbered("start")
    played = []
    for fmu in (shipped, built):
        forces = []
        for event_mode in modes(fmu):
            instance = Instance(fmu, event_mode)
            forces += instance.play(motion.push + motion.random(_COMPARED // 2, 10))
            for name in fmu.settable:
                instance.accepts(name, start[name] / 2 + 0.125)
            forces += instance.play(motion.random(_COMPARED // 2, 11, scale=3.0))
            forces += instance.play(motion.random(_LONG, 17))
        played.append(forces)
    if played[0] == played[1]:
        return []
    words = _first_difference(played[0], played[1], "from the library", "built from the FMU's own sources")
    return [f"{shipped.ports[1]}: {words}"]


def result_file(work: Path, number: int) -> Path:
    """Where the problems of a job are written."""
    return work / f"problems-{number}.json"


def main(arguments: list[str]) -> None:
    """Check FMUs in folders, or compare two, up to the first problem; write what is found as JSON, whole or not at all.

    The arguments are a folder for the results and the jobs as JSON: lists of folders by number.
    """
    work, jobs = Path(arguments[0]), json.loads(arguments[1])
    for number, folders in jobs.items():
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        fmus = [UnzippedFmu(Path(folder)) for folder in folders]
        found = problems_of(fmus[0]) if len(fmus) == 1 else compared(*fmus)
        written = work / f"{number}.part"
        written.write_text(json.dumps(found), encoding="utf-8")
        written.replace(result_file(work, number))
        if found:
            break
    faulthandler.cancel_dump_traceback_later()


if __name__ == "__main__":
    main(sys.argv[1:])
