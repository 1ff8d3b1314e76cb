"""An FMU under check: one instance with the same calls in both versions of FMI, and positions to play to it."""

import math
import random
from collections.abc import Callable, Iterable
from copy import copy
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lumbar.tissue.fmu.conventions import REFERENCE, element_names

_NUMBERS = count()


class UnzippedFmu:
    """An FMU in a `folder`, with what its `description` says, as fmpy reads it."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.description = fmpy.read_model_description(str(folder), validate=False)
        self.variables = {item.name: item for item in self.description.modelVariables}
        self._signals: dict[str, list] = {}

    @cached_property
    def version(self) -> int:
        """Of FMI: 2 or 3."""
        return int(self.description.fmiVersion[0])

    @cached_property
    def slave(self) -> FMU2Slave | FMU3Slave:
        """The library, without an instance: fmpy takes longer to load it than to play it."""
        return (FMU2Slave if self.version == 2 else FMU3Slave)(
            guid=self.description.guid,
            unzipDirectory=str(self.folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )

    @cached_property
    def ports(self) -> tuple[str, str]:
        """Names of the position and of the force: what the reference signals hold."""
        return tuple(self._lines(path)[0].split(",")[1].partition("[")[0] for path in REFERENCE)

    @cached_property
    def elements(self) -> dict[str, tuple[Any, int | None]]:
        """Every value by its name, with the variable that holds it and, of an array of FMI 3.0, where."""
        found: dict[str, tuple[Any, int | None]] = {}
        for name, item in self.variables.items():
            size = math.prod(part.start for part in item.dimensions or ())
            rows = {name: (item, None)}
            if item.dimensions:
                rows = {each: (item, row) for row, each in enumerate(element_names(name, size))}
            found |= rows
        return found

    def parts(self, port: str) -> list[str]:
        """Names of the values of a variable, one for every axis in space."""
        return [name for name in self.elements if name.partition("[")[0] == port]

    @cached_property
    def axes(self) -> int:
        """How many axes there are in space; 0 of one axis."""
        count = len(self.parts(self.ports[0]))
        return count if count > 1 else 0

    def references(self, port: str) -> list[int]:
        """Value references under which a variable with a value for every axis, or one, is set and read."""
        return list(dict.fromkeys(self.elements[name][0].valueReference for name in self.parts(port)))

    def signal(self, path: str) -> list:
        """Values of a reference signal by its path in the FMU; in space vectors."""
        if path not in self._signals:
            cells = (line.partition(",")[2].replace(",", " ").split() for line in self._lines(path)[1:])
            rows = [list(map(float, row)) for row in cells]
            self._signals[path] = rows if self.axes else [row[0] for row in rows]
        return self._signals[path]

    def _lines(self, path: str) -> list[str]:
        return (self.folder / path).read_text(encoding="utf-8").splitlines()

    @cached_property
    def sampling_time(self) -> float:
        """Seconds, as the description says."""
        simulation, experiment = self.description.coSimulation, self.description.defaultExperiment
        return float((simulation.fixedInternalStepSize if self.version == 3 else None) or experiment.stepSize)

    def numbered(self, attribute: str) -> dict[str, float]:
        """Return ``start``, ``min`` or ``max`` of the variables that have it."""
        given = {name: (getattr(item, attribute), row) for name, (item, row) in self.elements.items()}
        return {
            name: float(value if row is None or attribute != "start" else str(value).split()[row])
            for name, (value, row) in given.items()
            if value is not None
        }

    @property
    def settable(self) -> list[str]:
        """Names of the input and of the parameters that may be set while the FMU runs."""
        return [
            name
            for name, (item, _) in self.elements.items()
            if item.causality == "input" or (item.causality == "parameter" and item.variability == "tunable")
        ]


class Instance:
    """An instance in initialization mode, then one sample after the other.

    Parameters
    ----------
    fmu : UnzippedFmu
    event_mode : bool
        FMI 3.0 alone.
    token : str, optional
        Another than the description's.
    start : float
        Time of the first sample, s.
    parts : int
        Steps from one sample to the next, without event mode.
    """

    def __init__(
        self,
        fmu: UnzippedFmu,
        event_mode: bool = False,
        token: str | None = None,
        start: float = 0.0,
        parts: int = 1,
    ):
        self.fmu, self.event_mode, self.start, self.parts = fmu, event_mode, start, parts
        self.slave = copy(fmu.slave)
        self.slave.instanceName = f"checked {next(_NUMBERS)}"
        if token is not None:
            self.slave.guid = token
        if fmu.version == 2:
            self.slave.instantiate()
        else:
            self.slave.instantiate(eventModeUsed=event_mode, logMessage=lambda *_: None)
        self.initialize()

    def initialize(self) -> None:
        """Enter initialization mode at the start time."""
        if self.fmu.version == 2:
            self.slave.setupExperiment(startTime=self.start)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=self.start)
        self.samples = 0

    def free(self) -> None:
        """Free the instance; the library stays loaded for others."""
        slave = self.slave
        (slave.fmi2FreeInstance if self.fmu.version == 2 else slave.fmi3FreeInstance)(slave.component)

    def reset(self) -> None:
        """Reset, and enter initialization mode again."""
        self.slave.reset()
        self.initialize()

    def get(self, name: str) -> float:
        """A value by its name."""
        item, row = self.fmu.elements[name]
        return self._read([item.valueReference], 1 if row is None else self.fmu.axes)[row or 0]

    def set(self, name: str, value: float) -> None:
        """Set a value; an exception of fmpy where it is refused."""
        item, row = self.fmu.elements[name]
        values = [value] if row is None else self._read([item.valueReference], self.fmu.axes)
        values[row or 0] = value
        self._setter([item.valueReference], values)

    def read(self, port: str):
        """Position or force: a number, in space a vector."""
        values = self._read(self.fmu.references(port), self.fmu.axes or 1)
        return values if self.fmu.axes else values[0]

    def put(self, port: str, value) -> None:
        """Set position or force."""
        self._setter(self.fmu.references(port), value if self.fmu.axes else [value])

    @property
    def _setter(self) -> Callable:
        return self.slave.setReal if self.fmu.version == 2 else self.slave.setFloat64

    def _read(self, references: list[int], count: int) -> list[float]:
        if self.fmu.version == 2:
            return self.slave.getReal(references)
        return self.slave.getFloat64(references, count)

    def accepts(self, name: str, value: float) -> bool:
        """Set a variable; whether the FMU took it."""
        try:
            self.set(name, value)
        except FMICallException:
            return False
        return True

    def derivative(self, unknown: str, known: str) -> float:
        """Derivative of one variable by another at this moment."""
        (of, row), (by, column) = (self.fmu.elements[name] for name in (unknown, known))
        seed = [1.0] if column is None else [float(index == column) for index in range(self.fmu.axes)]
        given = [of.valueReference], [by.valueReference], seed
        if row is None:
            return self.slave.getDirectionalDerivative(*given)[0]
        return self.slave.getDirectionalDerivative(*given, self.fmu.axes)[row]

    def sample(self, position):
        """Force that a client reads at the next sample instant, where it sets this position.

        With event mode it reads after it has set the position, without one before; at the start always after.
        """
        source, force = self.fmu.ports
        if self.samples == 0:
            self.put(source, position)
            self.slave.exitInitializationMode()
        else:
            self.reach_sample()
            if self.event_mode:
                self.put(source, position)
        if self.event_mode:
            self.next_event = self.slave.updateDiscreteStates()[-1]
        read = self.read(force)
        if self.event_mode:
            self.slave.enterStepMode()
        else:
            self.put(source, position)
        self.samples += 1
        return read

    def reach_sample(self) -> None:
        """Step to the instant of the next sample, after the first one."""
        if self.samples == 0:
            return
        step = self.fmu.sampling_time
        for part in range(self.parts):
            self.slave.doStep(self.start + (self.samples - 1 + part / self.parts) * step, step / self.parts)
        if self.event_mode:
            self.slave.enterEventMode()

    def steps(self, begin: float, length: float) -> bool:
        """Take a step; whether the FMU took it."""
        try:
            self.slave.doStep(begin, length)
        except FMICallException:
            return False
        return True

    def play(self, positions: Iterable) -> list:
        """Force at each of the next sample instants."""
        return [self.sample(position) for position in positions]

    def save(self):
        """State of the simulation: FMI's handle, and where this driver was."""
        taken = self.slave.getFMUstate() if self.fmu.version == 2 else self.slave.getFMUState()
        return taken, self.samples

    def restore(self, saved) -> None:
        """Continue from a saved state."""
        (self.slave.setFMUstate if self.fmu.version == 2 else self.slave.setFMUState)(saved[0])
        self.samples = saved[1]

    def serialized(self, saved) -> tuple[bytes, int]:
        """A saved state as bytes."""
        slave = self.slave
        serialize = slave.serializeFMUstate if self.fmu.version == 2 else slave.serializeFMUState
        return serialize(saved[0]), saved[1]

    def deserialized(self, content: tuple[bytes, int]):
        """A saved state from bytes."""
        slave = self.slave
        deserialize = slave.deSerializeFMUstate if self.fmu.version == 2 else slave.deserializeFMUState
        return deserialize(content[0]), content[1]


class Motion:
    """Positions to play, about rest and of the reference push's size; in space vectors.

    Attributes
    ----------
    rest, span : float
        First position of the reference, and the largest distance from it.
    """

    def __init__(self, fmu: UnzippedFmu):
        self.axes = fmu.axes
        self.push = fmu.signal(REFERENCE[0])
        self.rest = np.array(self.push[0])
        self.span = float(np.abs(self.push - self.rest).max()) or 1.0

    def about_rest(self, way) -> list:
        """Positions of a way from rest."""
        return (self.rest + np.asarray(way)).tolist()

    def random(self, samples: int, seed: int, scale: float = 0.5) -> list:
        """A random walk within the push's span, mirrored at its ends."""
        walks = [self._walk(samples, seed + 100 * axis, scale) for axis in range(self.axes or 1)]
        return self.about_rest(np.transpose(walks) if self.axes else walks[0])

    def _walk(self, samples: int, seed: int, scale: float) -> list[float]:
        generator, position, positions = random.Random(seed), 0.0, []
        for _ in range(samples):
            position += generator.gauss(0.0, 0.2)
            position = max(-2.0 - position, min(2.0 - position, position))
            positions.append(scale * self.span * position)
        return positions


def modes(fmu: UnzippedFmu) -> list[bool]:
    """Whether with event mode: the ways in which the FMU can be played."""
    return [False, True] if fmu.version == 3 and fmu.description.coSimulation.hasEventMode else [False]


def way_in_words(event_mode: bool) -> str:
    """Say the way of playing in words."""
    return "with event mode" if event_mode else "without event mode"
