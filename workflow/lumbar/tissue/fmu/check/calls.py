"""What a library does with time, saved bytes and derivatives: that its calls mean what FMI says they mean."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from itertools import pairwise

from lumbar.tissue.fmu.check.instance import Instance, UnzippedFmu
from lumbar.tissue.fmu.check.motion import Motion, modes, named
from lumbar.tissue.fmu.conventions import told_meaning, work_units

_SAMPLES = 40
_SLOPE = 2.0**-20
"""Of the motion's span: small enough for a slope, large enough for its rounding."""
_HAND = 400
"""Steps of a hand."""
_ROUNDING = 1e-12
"""Of energies, in J."""
_TOLERANCE = 1e-3
"""Of a slope by differences, relative to the largest."""


def check_steps(fmu: UnzippedFmu) -> Iterator[str]:
    """However a sample's time is divided into steps, and whenever it starts, the forces are the same."""
    positions, force = Motion(fmu).random(_SAMPLES, 12), fmu.ports[1]
    expected = Instance(fmu).play(positions)
    for parts, start in ((2, 0.0), (7, 0.0), (1, 1000.0)):
        found = Instance(fmu, start=start, parts=parts).play(positions)
        if found != expected:
            at = next(k for k, pair in enumerate(zip(found, expected, strict=True)) if pair[0] != pair[1])
            how = f"in {parts} steps a sample" if parts > 1 else f"from {start:g} s on"
            yield f"{force}: played {how} it is {found[at]!r} at sample {at}; in one step a sample from 0 s {expected[at]!r}"


def check_refused_steps(fmu: UnzippedFmu) -> Iterator[str]:
    """A step back in time, of no length or from elsewhere is refused, and changes nothing."""
    positions, step = Motion(fmu).random(_SAMPLES, 13), fmu.sampling_time
    for event_mode in modes(fmu):
        expected = Instance(fmu, event_mode).play(positions)
        instance = Instance(fmu, event_mode)
        instance.play(positions[:-1])
        now = (instance.samples - 1) * step
        for begin, length, what in (
            (now, -step, "back in time"),
            (now, 0.0, "of no length"),
            (now + step / 2, step, "that does not begin where the last one ended"),
        ):
            if instance.steps(begin, length):
                yield f"doStep: {named(event_mode)} the library takes a step {what}; it must refuse it"
                break
        else:
            found = instance.sample(positions[-1])
            if found != expected[-1]:
                yield f"{fmu.ports[1]}: {found!r} after steps that were refused; without them {expected[-1]!r}"


def check_damaged_bytes(fmu: UnzippedFmu) -> Iterator[str]:
    """Bytes of a state of which one was changed are refused."""
    from fmpy.fmi1 import FMICallException

    instance = Instance(fmu)
    instance.play(Motion(fmu).random(_SAMPLES, 14))
    content, samples = instance.serialized(instance.save())
    content = bytes(content)
    for place in (0, len(content) // 2, len(content) - 1):
        damaged = content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]
        try:
            instance.deserialized((damaged, samples))
        except FMICallException:
            continue
        yield f"the library takes the bytes of a state with byte {place} changed; it must refuse them"
        return


def check_slope(fmu: UnzippedFmu) -> Iterator[str]:
    """The derivative of the force by the position is how the force changes with it; at most samples, for forces have kinks."""
    (position, force), motion, event_mode = fmu.ports, Motion(fmu), modes(fmu)[-1]
    references = [[fmu.variables[name].valueReference] for name in (force, position)]
    positions, pairs = motion.random(_SAMPLES, 15, scale=0.2), []
    small = _SLOPE * motion.span
    for k in range(3, len(positions), 4):
        instance = Instance(fmu, event_mode)
        instance.play(positions[:k])
        instance.reach_sample()
        forces = []
        for moved in (small, -small, 0.0):
            instance.set(position, positions[k] + moved)
            forces.append(instance.get(force))
        told = instance.slave.getDirectionalDerivative(*references, [1.0])[0]
        pairs.append((told, (forces[0] - forces[1]) / (2 * small)))
    largest = max(abs(value) for pair in pairs for value in pair) or 1.0
    off = [pair for pair in pairs if abs(pair[0] - pair[1]) > _TOLERANCE * largest]
    if 2 * len(off) > len(pairs):
        told, found = off[0]
        yield f"{force}: the library's derivative by {position} is {told:.6g}; by differences it is {found:.6g}"


def check_energy(fmu: UnzippedFmu) -> Iterator[str]:
    """A passive FMU gives out no more than it took in, even to a hand that takes out all it can, and tells its energy."""
    work = work_units(*(fmu.variables[name].unit or "" for name in fmu.ports))
    if "device_damping" not in fmu.variables or work is None:
        return
    start = fmu.numbered("start")["device_damping"]
    for event_mode in modes(fmu):
        for damping in (start, start / 1000):  # with little of it the force is bounded at every sample
            yield from _handled(fmu, event_mode, damping, *work[:2])


def _handled(
    fmu: UnzippedFmu, event_mode: bool, damping: float, unit: float, force_unit: float
) -> Iterator[str]:
    """What a hand finds that takes out all it can at every other step."""
    step, sign, reserve = fmu.sampling_time, resistance(fmu), fmu.numbered("start")["energy_reserve"]
    wander, instance = Motion(fmu).random(_HAND, 16), Instance(fmu, event_mode)
    instance.set("device_damping", damping)
    place = wander[0]
    shown, energy, taken, least = instance.sample(place) * force_unit * sign, 0.0, 0.0, 0.0
    for k, (one, other) in enumerate(pairwise(wander)):
        # What a held force f gives out is largest over a displacement of -f T / (2 b).
        moved = (other - one) * unit if k % 2 else -shown * step / (2 * damping)
        place += moved / unit
        given = shown * moved + damping * moved * moved / step
        taken, before, energy = taken + given, energy, min(energy + given, reserve)
        least = min(least, taken)
        shown = instance.sample(place) * force_unit * sign
        # Without event mode the last sample taken is the one before, and the library tells the least of what it can be.
        known = energy if event_mode else before
        excess = instance.get("energy") - known
        if excess > _ROUNDING * (1 + reserve) or (event_mode and excess < -_ROUNDING * (1 + reserve)):
            yield (
                f"energy: {named(event_mode)} the library tells {known + excess:.6g} J at sample {k + 1}; force, motion "
                f"and damping give {known:.6g} J"
            )
            return
    if least < -_ROUNDING:
        yield (
            f"{fmu.ports[1]}: {named(event_mode)} a hand takes {-least:.3g} J more out of FMU and device than it gives; "
            "with device_damping an FMU is passive"
        )


def resistance(fmu: UnzippedFmu) -> int:
    """Sign of the force that counts as resisting where it is displayed: a prescribed model is displayed like the others."""
    told = told_meaning(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot()) or {}
    return 1 if told.get("prescribed") else told.get("resisting_sign", 1)
