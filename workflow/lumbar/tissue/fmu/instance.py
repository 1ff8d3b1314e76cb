"""Running an exported FMU: one instance with the same calls in both versions of FMI."""

import math
from collections.abc import Iterable
from copy import copy
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lumbar.tissue.fmu.conventions import REFERENCE, element_names

_NUMBERS = count()


class UnzippedFmu:
    """An FMU in a `folder`, with its `description` as fmpy reads it."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.description = fmpy.read_model_description(str(folder), validate=False)
        self.variables = {item.name: item for item in self.description.modelVariables}

    @cached_property
    def version(self) -> int:
        """Version of FMI: 2 or 3."""
        return int(self.description.fmiVersion[0])

    @cached_property
    def slave(self) -> FMU2Slave | FMU3Slave:
        """The library, without an instance: fmpy takes longer to load it than to run it."""
        return (FMU2Slave if self.version == 2 else FMU3Slave)(
            guid=self.description.guid,
            unzipDirectory=str(self.folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )

    @cached_property
    def ports(self) -> tuple[str, str]:
        """Names of the variables for position and force, from the reference signals."""
        heads = ((self.folder / path).read_text(encoding="utf-8").splitlines()[0] for path in REFERENCE)
        return tuple(head.split(",")[1].partition("[")[0] for head in heads)

    @cached_property
    def elements(self) -> dict[str, tuple[Any, int | None]]:
        """Variable and index in its array (FMI 3.0; else None) of each scalar value, by the name of the value."""
        elements: dict[str, tuple[Any, int | None]] = {}
        for name, item in self.variables.items():
            if item.dimensions:
                size = math.prod(part.start for part in item.dimensions)
                elements |= {each: (item, row) for row, each in enumerate(element_names(name, size))}
            else:
                elements[name] = (item, None)
        return elements

    def parts(self, port: str) -> list[str]:
        """Return the names of the scalar values of a variable: one per axis in space."""
        return [name for name in self.elements if name.partition("[")[0] == port]

    @cached_property
    def axes(self) -> int:
        """Number of axes in space; 0 along one axis."""
        count = len(self.parts(self.ports[0]))
        return count if count > 1 else 0

    def references(self, port: str) -> list[int]:
        """Return the value references of a variable: one per axis in FMI 2.0, one in FMI 3.0."""
        return list(dict.fromkeys(self.elements[name][0].valueReference for name in self.parts(port)))

    @cached_property
    def sampling_time(self) -> float:
        """Sampling time in seconds."""
        simulation, experiment = self.description.coSimulation, self.description.defaultExperiment
        return float((simulation.fixedInternalStepSize if self.version == 3 else None) or experiment.stepSize)


class Instance:
    """An instance of an FMU: first in initialization mode, then stepped from sample to sample (in event mode with FMI 3.0)."""

    def __init__(self, fmu: UnzippedFmu, event_mode: bool = False):
        self.fmu, self.event_mode = fmu, event_mode
        self.slave = copy(fmu.slave)
        self.slave.instanceName = f"instance {next(_NUMBERS)}"
        if fmu.version == 2:
            self.slave.instantiate()
        else:
            self.slave.instantiate(eventModeUsed=event_mode, logMessage=lambda *_: None)
        self.initialize()

    def initialize(self, start: float = 0.0) -> None:
        """Enter initialization mode at a time in seconds."""
        if self.fmu.version == 2:
            self.slave.setupExperiment(startTime=start)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=start)
        self.samples = 0

    def free(self) -> None:
        """Free the instance; the library stays loaded for others."""
        slave = self.slave
        (slave.fmi2FreeInstance if self.fmu.version == 2 else slave.fmi3FreeInstance)(slave.component)

    def read(self, port: str):
        """Return position or force: a number, in space a list."""
        references = self.fmu.references(port)
        if self.fmu.version == 2:
            values = self.slave.getReal(references)
        else:
            values = self.slave.getFloat64(references, self.fmu.axes or 1)
        return values if self.fmu.axes else values[0]

    def write(self, port: str, value) -> None:
        """Set position or force: a number, in space a list."""
        setter = self.slave.setReal if self.fmu.version == 2 else self.slave.setFloat64
        setter(self.fmu.references(port), value if self.fmu.axes else [value])

    def sample(self, position):
        """Set the position at the next sample instant and return the force that a client reads there.

        With event mode, and at the start, the position is set before the force is read; else after it.
        """
        source, force = self.fmu.ports
        self.reach_sample()
        if self.event_mode or self.samples == 0:
            self.write(source, position)
        if self.samples == 0:
            self.slave.exitInitializationMode()
        if self.event_mode:
            self.slave.updateDiscreteStates()
        value = self.read(force)
        if self.event_mode:
            self.slave.enterStepMode()
        else:
            self.write(source, position)
        self.samples += 1
        return value

    def reach_sample(self) -> None:
        """Step to the next sample instant; do nothing at the first instant."""
        if self.samples == 0:
            return
        step = self.fmu.sampling_time
        self.slave.doStep((self.samples - 1) * step, step)
        if self.event_mode:
            self.slave.enterEventMode()

    def play(self, positions: Iterable) -> list:
        """Return the forces at the next sample instants for these positions."""
        return [self.sample(position) for position in positions]
