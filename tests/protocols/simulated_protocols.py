"""Mechanical tests of tissue as laboratories run them, simulated at 2 kHz or more with numpy and scipy only.

A protocol is a function of a random generator; it returns the records' motions (or forces) and the rate of the recording.
`draw_case` adds a tissue, a hidden effect and noise. Nothing here is shared with the library.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import chirp, lfilter, max_len_seq

FINE_HZ = 2000
NOISE_SHARE = 0.008
"""RMS of the noise in the standard deviation of the first record's force."""
EFFECT_OVER_NOISE = 8.0
"""Error of the best base without the effect, in noise; less if the effect's force would exceed that of the base."""
EFFECTS = ("coulomb_friction", "hardening_stiffness", "second_relaxation", "hysteresis", "viscous_damping")
BASES = ("KB", "LE", "KV", "Maxwell", "two_branches")


@dataclass(frozen=True)
class Motion:
    """A commanded course, on the fine grid of `FINE_HZ`."""

    name: str
    course: np.ndarray
    rate: int
    """Rate (Hz) of the recording, a divisor of `FINE_HZ`."""


@dataclass(frozen=True)
class Case:
    """One experiment and its truth."""

    protocol: str
    hidden: tuple[str, ...]
    base: dict[str, float]
    records: dict[str, np.ndarray]
    """Columns of time (s), position (mm) and force (N) by name."""
    forward: bool
    effect_over_noise: float


# Motions -------------------------------------------------------------------------------------------------------------


def _path(*legs: tuple[float, float], start: float = 0.0) -> np.ndarray:
    """Return a course through (target, seconds), with corners that a drive rounds within 10 ms."""
    parts, place = [], start
    for target, seconds in legs:
        parts.append(np.linspace(place, target, max(round(seconds * FINE_HZ), 1) + 1)[1:])
        place = target
    return _round_off(np.concatenate(parts), start)


def _round_off(course: np.ndarray, start: float = 0.0, seconds: float = 0.01) -> np.ndarray:
    width = round(seconds * FINE_HZ)
    padded = np.concatenate([np.full(width - 1, start), course])
    return np.convolve(padded, np.full(width, 1 / width), "valid")


def _clock(seconds: float) -> np.ndarray:
    return np.arange(round(seconds * FINE_HZ)) / FINE_HZ


def _band_noise(rng: np.random.Generator, seconds: float, low: float, high: float) -> np.ndarray:
    """Return noise of RMS 1 in a band (Hz)."""
    size = round(seconds * FINE_HZ)
    frequency = np.fft.rfftfreq(size, 1 / FINE_HZ)
    spectrum = rng.standard_normal(len(frequency)) + 1j * rng.standard_normal(len(frequency))
    values = np.fft.irfft(spectrum * ((frequency >= low) & (frequency <= high)), size)
    return values / values.std()


def _levels(values: np.ndarray, seconds: float, slew: float) -> np.ndarray:
    """Return steps between levels, each held for `seconds`, at a finite speed (mm/s)."""
    legs = []
    for before, level in zip([0.0, *values[:-1]], values, strict=True):
        move = abs(level - before) / slew
        legs += [(level, move), (level, max(seconds - move, 0.02))]
    return _path(*legs)


def relaxation_at_several_strains(rng):
    depth, back = rng.uniform(1.0, 1.4), rng.uniform(6, 10)
    for number in (1, 2, 3):
        top = number * depth
        legs = ((0, 1), (top, top / 20), (top, 12), (0, top / 2), (0, back))
        yield Motion(f"strain_{number}", _path(*legs), 50)


def ramp_hold_ramp(rng):
    top = rng.uniform(3, 6)
    for speed in (1, 4, 16):
        up, down = top / speed, top / speed / 2
        legs = (
            (0, 0.5),
            (0.5 * top, up / 2),
            (0.5 * top, 4),
            (top, up / 2),
            (top, 4),
            (0.25 * top, down),
            (0, down),
            (0, 3),
        )
        yield Motion(f"speed_{speed}", _path(*legs), 100)


def triangles_with_dwell(rng):
    top = rng.uniform(3, 6)
    for speed, share in ((2, 1.0), (10, 0.6), (25, 1.0)):
        height = share * top
        legs = 4 * ((height, height / speed), (height, 1.0), (0, height / speed), (0, 1.0))
        yield Motion(f"triangles_{speed}", _path((0, 0.5), *legs), 100)


def sawtooth_with_holds(rng):
    top = rng.uniform(3, 6)
    for speed in (1.5, 6):
        legs = [(0, 0.5)]
        for height in top * np.array([0.4, 0.7, 1.0, 0.55, 0.85]):
            legs += [(height, height / speed), (height, 1.5), (0, height / 40), (0, 1.5)]
        yield Motion(f"saw_{speed}", _path(*legs), 100)


def swept_amplitude(rng):
    top = rng.uniform(3, 7)
    for hertz, seconds in ((0.8, 30), (2.5, 20)):
        time = _clock(seconds)
        yield Motion(f"sweep_{hertz}", top * time / seconds * np.sin(2 * np.pi * hertz * time), 100)


def haversine_impacts(rng):
    for name, shortest, longest in (("hits_a", 0.03, 0.12), ("hits_b", 0.06, 0.25)):
        parts = []
        for _ in range(14):
            width, height = rng.uniform(shortest, longest), rng.uniform(1, 5)
            time = _clock(width)
            parts += [
                height * np.sin(np.pi * time / width) ** 2,
                np.zeros(round(rng.uniform(0.3, 0.8) * FINE_HZ)),
            ]
        yield Motion(name, np.concatenate([np.zeros(400), *parts]), 500)


def random_steps(rng):
    for name, seconds, slew in (("steps_a", 0.7, 30.0), ("steps_b", 0.4, 60.0)):
        yield Motion(name, _levels(rng.uniform(-4, 4, 40), seconds, slew), 100)


def multisine_with_rests(rng):
    for name, share in (("bursts_a", 1.0), ("bursts_b", 0.7)):
        parts = []
        for _ in range(4):
            burst = _band_noise(rng, 5, 0.2, 5) * np.minimum(1, 4 * np.sin(np.pi * _clock(5) / 5))
            parts += [1.8 * share * burst, np.zeros(2 * FINE_HZ)]
        yield Motion(name, np.concatenate([np.zeros(FINE_HZ), *parts]), 100)


def two_tone(rng):
    for first, second, seconds in ((0.31, 2.17, 30), (0.73, 3.41, 20)):
        time, angle = _clock(seconds), rng.uniform(0, 6)
        course = 3 * np.sin(2 * np.pi * first * time) + 1.5 * np.sin(2 * np.pi * second * time + angle)
        yield Motion(f"tones_{first}", course, 100)


def narrow_band_noise(rng):
    for name, low, high in (("slow", 0.1, 2), ("fast", 1, 8)):
        yield Motion(name, rng.uniform(1.5, 2.5) * _band_noise(rng, 20, low, high), 100)


def binary_of_other_clocks(rng):
    size = rng.uniform(2, 4)
    for register, clock in ((7, 0.15), (6, 0.4)):
        bits = 2.0 * max_len_seq(register, state=rng.integers(0, 2, register) | 1)[0] - 1
        yield Motion(
            f"clock_{clock}", _round_off(size * np.repeat(bits, round(clock * FINE_HZ)), seconds=0.02), 100
        )


def ternary(rng):
    size = rng.uniform(3, 6)
    for name, clock, count in (("ternary_a", 0.35, 90), ("ternary_b", 0.6, 40)):
        course = np.repeat(size * rng.choice([0.0, 0.35, 1.0], count), round(clock * FINE_HZ))
        yield Motion(name, _round_off(course, seconds=0.04), 100)


def three_cycle_indentation(rng):
    top = rng.uniform(3, 5)
    for name, speed in (("indent_slow", 1.0), ("indent_fast", 8.0)):
        legs = [(0, 1)]
        for height in top * np.array([0.5, 0.75, 1.0]):
            legs += [(height, height / speed), (height, 3), (0.2 * height, height / speed), (0.2 * height, 2)]
        yield Motion(name, _path(*legs), 100)


def prestrain_and_chirp(rng):
    strain, size = rng.uniform(4, 6), rng.uniform(1.5, 2.5)
    for name, first, last in (("chirp_up", 0.1, 6), ("chirp_down", 6, 0.1)):
        time = _clock(25)
        yield Motion(name, strain + size * chirp(time, first, 25, last, "logarithmic"), 100)


def slow_at_10_hz(rng):
    for name, seconds in (("slow_a", 120), ("slow_b", 60)):
        yield Motion(name, 2.0 * _band_noise(rng, seconds, 0.02, 0.8), 10)


def fast_and_long(rng):
    for name, seconds in (("long", 30), ("short", 10)):
        yield Motion(name, 2.0 * _band_noise(rng, seconds, 0.1, 10), 2000)


def creep_under_dead_weight(rng):
    for name, weight in (("light", rng.uniform(0.8, 1.2)), ("heavy", rng.uniform(2, 3))):
        yield Motion(
            name,
            np.concatenate([np.zeros(FINE_HZ), np.full(30 * FINE_HZ, weight), np.zeros(15 * FINE_HZ)]),
            50,
        )


def creep_staircase(rng):
    step = rng.uniform(0.5, 0.9)
    for name, heights in (("stairs_a", (1, 2, 3, 4)), ("stairs_b", (2, 4, 1, 3, 0))):
        yield Motion(name, np.repeat(step * np.array([0, *heights]), 8 * FINE_HZ), 50)


def force_ramps(rng):
    top = rng.uniform(2, 4)
    for speed in (0.2, 2.0):
        yield Motion(
            f"ramp_{speed}", _path((0, 1), (top, top / speed), (top, 8), (0, top / speed), (0, 8)), 50
        )


def force_triangles(rng):
    top = rng.uniform(2, 4)
    for speed in (0.5, 4.0):
        yield Motion(f"triangles_{speed}", _path((0, 1), *4 * ((top, top / speed), (0, top / speed))), 50)


PROTOCOLS: dict[str, Callable] = {
    item.__name__: item
    for item in (
        *(
            relaxation_at_several_strains,
            ramp_hold_ramp,
            triangles_with_dwell,
            sawtooth_with_holds,
            swept_amplitude,
        ),
        *(
            haversine_impacts,
            random_steps,
            multisine_with_rests,
            two_tone,
            narrow_band_noise,
            binary_of_other_clocks,
        ),
        *(ternary, three_cycle_indentation, prestrain_and_chirp, slow_at_10_hz, fast_and_long),
    )
}
"""Protocols that prescribe the position."""
LOAD_PROTOCOLS: dict[str, Callable] = {
    item.__name__: item for item in (creep_under_dead_weight, creep_staircase, force_ramps, force_triangles)
}
"""Protocols that prescribe the force."""
DASHPOT_PROTOCOLS = ("multisine_with_rests", "narrow_band_noise", "random_steps", "prestrain_and_chirp")


# Tissue --------------------------------------------------------------------------------------------------------------


def _draw_base(rng: np.random.Generator, kind: str) -> dict[str, float]:
    """Return stiffnesses (N/mm), relaxation times (s) and damping (N s/mm) of a linear tissue."""
    spring, branch, time = rng.uniform(0.25, 0.9), rng.uniform(0.4, 1.8), rng.uniform(0.1, 0.6)
    return {
        "KB": {"ke": spring, "k": branch, "tau": time},
        "LE": {"ke": spring},
        "KV": {"ke": spring, "c": spring * rng.uniform(0.03, 0.15)},
        "Maxwell": {"k": branch, "tau": 4 * time},
        "two_branches": {"ke": spring, "k": branch, "tau": time / 4, "k2": 0.6 * branch, "tau2": 3 * time},
    }[kind]


def _branch(course: np.ndarray, time: float) -> np.ndarray:
    """Return the stretch of a spring in series with a dashpot, for a course that is straight between samples."""
    decay = np.exp(-1 / (FINE_HZ * time))
    change = np.diff(course, prepend=course[0])
    return lfilter([time * FINE_HZ * (1 - decay)], [1, -decay], change)


def _base_force(base: dict[str, float], course: np.ndarray) -> np.ndarray:
    force = base.get("ke", 0.0) * course + base.get("c", 0.0) * np.gradient(course, 1 / FINE_HZ)
    for stiffness, time in (("k", "tau"), ("k2", "tau2")):
        if stiffness in base:
            force = force + base[stiffness] * _branch(course, base[time])
    return force


def _effect_force(
    rng: np.random.Generator, name: str, courses: list[np.ndarray], base: dict
) -> list[np.ndarray]:
    """Return the force of an effect of unit size, per course."""
    span, draw = max(np.ptp(course) for course in courses), rng.random()
    moving = np.concatenate([np.abs(np.gradient(course, 1 / FINE_HZ)) for course in courses])
    speed = np.median(moving[moving > 1e-3])

    def dahl(course: np.ndarray) -> np.ndarray:
        distance, values, value = (0.04 + 0.06 * draw) * span, [], 0.0
        for step in np.diff(course, prepend=course[0]).tolist():
            limit = 1.0 if step > 0 else -1.0
            value = limit + (value - limit) * np.exp(-abs(step) / distance)
            values.append(value)
        return np.array(values)

    forces = {
        "coulomb_friction": lambda course: np.tanh(np.gradient(course, 1 / FINE_HZ) / (0.03 * speed)),
        "hardening_stiffness": lambda course: course**3,
        "second_relaxation": lambda course: _branch(course, base["tau"] * (6 + 6 * draw)),
        "hysteresis": dahl,
        "viscous_damping": lambda course: np.gradient(course, 1 / FINE_HZ),
    }
    return [forces[name](course) for course in courses]


def _best_base_error(course: np.ndarray, force: np.ndarray, every: int) -> float:
    """Return the RMS that the best Kelvin–Boltzmann tissue leaves of a force."""

    def error(logarithm: float) -> float:
        columns = np.column_stack([np.ones_like(course), course, _branch(course, np.exp(logarithm))])[::every]
        return float(
            np.std(force[::every] - columns @ np.linalg.lstsq(columns, force[::every], rcond=None)[0])
        )

    grid = np.linspace(np.log(0.02), np.log(20), 15)
    best = grid[np.argmin([error(item) for item in grid])]
    return minimize_scalar(error, bounds=(best - 0.6, best + 0.6), method="bounded").fun


def _creep(base: dict[str, float], force: np.ndarray, cubic: float) -> np.ndarray:
    """Return the position of a Kelvin–Boltzmann tissue under a force, with a cubic spring parallel to its spring.

    The position solves ke z + cubic z³ + k (z - x) = F; the dashpot's x follows x' = (z - x)/tau by the midpoint rule.
    """
    stiffness, branch, step = base["ke"], base["k"], 1 / FINE_HZ

    def position(load: float, behind: float, start: float) -> float:
        for _ in range(2 if cubic else 1):
            error = stiffness * start + cubic * start**3 + branch * (start - behind) - load
            start -= error / (stiffness + 3 * cubic * start**2 + branch)
        return start

    behind, place, places = 0.0, 0.0, []
    for load in force.tolist():
        place = position(load, behind, place)
        places.append(place)
        middle = behind + 0.5 * step * (place - behind) / base["tau"]
        behind += step * (position(load, middle, place) - middle) / base["tau"]
    return np.array(places)


# Cases ---------------------------------------------------------------------------------------------------------------


def list_cases() -> dict[str, tuple[str, str, str, int]]:
    """Return protocol, hidden effect (or an empty text), base and seed of every case, by name."""
    wanted = [(protocol, effect) for protocol in PROTOCOLS for effect in ("", *EFFECTS[:4])]
    wanted += [(protocol, "viscous_damping") for protocol in DASHPOT_PROTOCOLS]
    wanted += [(protocol, effect) for protocol in LOAD_PROTOCOLS for effect in ("", "hardening_stiffness")]
    return {f"o{number:02d}": (*item, "KB", 1) for number, item in enumerate(wanted)}


def draw_case(protocol: str, hidden: str, base: str, seed: int) -> Case:
    """Simulate a protocol on a tissue (of `BASES`) with a hidden effect (of `EFFECTS`, or an empty text)."""
    rng = np.random.default_rng([seed, *(zlib.crc32(text.encode()) for text in (protocol, hidden, base))])
    tissue, forward, size = _draw_base(rng, base), protocol in LOAD_PROTOCOLS, 0.0
    motions = list((LOAD_PROTOCOLS if forward else PROTOCOLS)[protocol](rng))
    inputs, every = [motion.course for motion in motions], FINE_HZ // motions[0].rate
    if forward:
        largest = max(np.abs(item).max() for item in inputs) / tissue["ke"]
        # The cubic spring carries up to as much as the spring.
        cubic = rng.uniform(0.5, 1.0) * tissue["ke"] / largest**2 if hidden else 0.0
        outputs = [_creep(tissue, item, cubic) for item in inputs]
        noise = NOISE_SHARE * np.std(outputs[0])
    else:
        outputs = [_base_force(tissue, item) for item in inputs]
        noise = NOISE_SHARE * np.std(outputs[0])
        if hidden:
            effects = _effect_force(rng, hidden, inputs, tissue)
            most = np.std(outputs[0]) / max(np.std(effects[0]), 1e-12)
            factor = 0.1 * most
            for _ in range(5):
                size = _best_base_error(inputs[0], outputs[0] + factor * effects[0], every) / noise
                factor = min(factor * EFFECT_OVER_NOISE / max(size, 1e-6), most)
            outputs = [output + factor * effect for output, effect in zip(outputs, effects, strict=True)]
    records = {}
    for motion, driven, output in zip(motions, inputs, outputs, strict=True):
        step = FINE_HZ // motion.rate
        driven, output = driven[::step], output[::step]
        output = output + noise * rng.standard_normal(len(output))
        columns = (output, driven) if forward else (driven, output)
        records[motion.name] = np.column_stack([np.arange(len(output)) / motion.rate, *columns])
    return Case(protocol, (hidden,) if hidden else (), tissue, records, forward, size)


def write_case(folder: Path, case: Case) -> None:
    """Write the records of a case into ``folder/records``."""
    target = folder / "records"
    target.mkdir(parents=True, exist_ok=True)
    for name, columns in case.records.items():
        header, digits = "time_s,position_mm,force_N", ["%.6f", "%.7g", "%.7g"]
        np.savetxt(target / f"{name}.csv", columns, digits, ",", header=header, comments="")
