"""An FMU under check: one instance with the same calls in both versions of FMI, and positions to play to it."""

import random
from collections.abc import Iterable
from copy import copy
from functools import cached_property
from itertools import count
from pathlib import Path

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from lumbar.tissue.fmu.conventions import REFERENCE

_NUMBERS = count()


class UnzippedFmu:
    """An FMU in a `folder`, with what its `description` says, as fmpy reads it."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.description = fmpy.read_model_description(str(folder), validate=False)
        self.variables = {item.name: item for item in self.description.modelVariables}
        self._signals: dict[str, list[float]] = {}

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
        return tuple(self._lines(path)[0].split(",")[1] for path in REFERENCE)

    def signal(self, path: str) -> list[float]:
        """Values of a reference signal by its path in the FMU."""
        if path not in self._signals:
            self._signals[path] = [float(line.split(",")[1]) for line in self._lines(path)[1:]]
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
        given = {name: getattr(item, attribute) for name, item in self.variables.items()}
        return {name: float(value) for name, value in given.items() if value is not None}

    @property
    def settable(self) -> list[str]:
        """Names of the input and of the parameters that may be set while the FMU runs."""
        return [
            name
            for name, item in self.variables.items()
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
        """Value of a variable."""
        getter = self.slave.getReal if self.fmu.version == 2 else self.slave.getFloat64
        return getter([self.fmu.variables[name].valueReference])[0]

    def set(self, name: str, value: float) -> None:
        """Set a variable; an exception of fmpy where it is refused."""
        setter = self.slave.setReal if self.fmu.version == 2 else self.slave.setFloat64
        setter([self.fmu.variables[name].valueReference], [value])

    def accepts(self, name: str, value: float) -> bool:
        """Set a variable; whether the FMU took it."""
        try:
            self.set(name, value)
        except FMICallException:
            return False
        return True

    def derivative(self, unknown: str, known: str) -> float:
        """Derivative of one variable by another at this moment."""
        references = ([self.fmu.variables[name].valueReference] for name in (unknown, known))
        return self.slave.getDirectionalDerivative(*references, [1.0])[0]

    def sample(self, position: float) -> float:
        """Force that a client reads at the next sample instant, where it sets this position.

        With event mode it reads after it has set the position, without one before; at the start always after.
        """
        source, force = self.fmu.ports
        if self.samples == 0:
            self.set(source, position)
            self.slave.exitInitializationMode()
        else:
            self.reach_sample()
            if self.event_mode:
                self.set(source, position)
        if self.event_mode:
            self.next_event = self.slave.updateDiscreteStates()[-1]
        read = self.get(force)
        if self.event_mode:
            self.slave.enterStepMode()
        else:
            self.set(source, position)
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

    def play(self, positions: Iterable[float]) -> list[float]:
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
    """Positions to play, about rest and of the reference push's size.

    Attributes
    ----------
    rest, span : float
        First position of the reference, and the largest distance from it.
    """

    def __init__(self, fmu: UnzippedFmu):
        self.push = fmu.signal(REFERENCE[0])
        self.rest = self.push[0]
        self.span = max(abs(position - self.rest) for position in self.push) or 1.0

    def random(self, samples: int, seed: int, scale: float = 0.5) -> list[float]:
        """A random walk within the push's span, mirrored at its ends."""
        generator, position, positions = random.Random(seed), 0.0, []
        for _ in range(samples):
            position += generator.gauss(0.0, 0.2)
            position = max(-2.0 - position, min(2.0 - position, position))
            positions.append(self.rest + scale * self.span * position)
        return positions


def modes(fmu: UnzippedFmu) -> list[bool]:
    """Whether with event mode: the ways in which the FMU can be played."""
    return [False, True] if fmu.version == 3 and fmu.description.coSimulation.hasEventMode else [False]


def way_in_words(event_mode: bool) -> str:
    """Say the way of playing in words."""
    return "with event mode" if event_mode else "without event mode"
