"""An exported FMU that a test drives: values by their names, states, resets, steps in parts, and motions to play."""

import json
import random
from xml.etree.ElementTree import Element

import numpy as np
from fmpy.fmi1 import FMICallException

from lumbar.tissue.fmu.conventions import ANNOTATION, REFERENCE
from lumbar.tissue.fmu.instance import Instance, UnzippedFmu


class DrivenFmu(UnzippedFmu):
    """An unzipped FMU with its reference signals and the numbers of its variables."""

    def signal(self, path: str) -> list:
        """Values of a reference signal by its path in the FMU; in space vectors."""
        lines = (self.folder / path).read_text(encoding="utf-8").splitlines()
        cells = (line.partition(",")[2].replace(",", " ").split() for line in lines[1:])
        rows = [list(map(float, row)) for row in cells]
        return rows if self.axes else [row[0] for row in rows]

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


class DrivenInstance(Instance):
    """An instance that starts at a time in seconds and goes from sample to sample in several steps."""

    def __init__(self, fmu: DrivenFmu, event_mode: bool = False, start: float = 0.0, parts: int = 1):
        self.start, self.parts = start, parts
        super().__init__(fmu, event_mode)

    def initialize(self) -> None:
        super().initialize(self.start)

    def reach_sample(self) -> None:
        if self.parts == 1 and not self.start:
            super().reach_sample()
            return
        step = self.fmu.sampling_time
        for part in range(self.parts if self.samples else 0):
            begin = self.start + (self.samples - 1 + part / self.parts) * step
            self.slave.doStep(begin, step / self.parts)

    def _values(self, item, row) -> list[float]:
        count = 1 if row is None else self.fmu.axes
        given = [item.valueReference]
        return self.slave.getReal(given) if self.fmu.version == 2 else self.slave.getFloat64(given, count)

    def _give(self, references: list[int], values: list[float]) -> None:
        (self.slave.setReal if self.fmu.version == 2 else self.slave.setFloat64)(references, values)

    def reset(self) -> None:
        """Reset, and enter initialization mode again."""
        self.slave.reset()
        self.initialize()

    def get(self, name: str) -> float:
        """A value by its name."""
        item, row = self.fmu.elements[name]
        return self._values(item, row)[row or 0]

    def set(self, name: str, value: float) -> None:
        """Set a value; an exception of fmpy where it is refused."""
        item, row = self.fmu.elements[name]
        values = [value] if row is None else self._values(item, row)
        values[row or 0] = value
        self._give([item.valueReference], values)

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

    def __init__(self, fmu: DrivenFmu):
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


def modes(fmu: DrivenFmu) -> list[bool]:
    """Whether with event mode: the ways in which the FMU can be played."""
    return [False, True] if fmu.version == 3 and fmu.description.coSimulation.hasEventMode else [False]


def read_annotation(root: Element) -> dict | None:
    """Return the annotation of a model description; None if there is none that can be read."""
    element = root.find(f"VendorAnnotations/Tool[@name='{ANNOTATION}']/Meaning")
    if element is not None:
        return {key: _value(text) for key, text in element.attrib.items()}
    meaning = _value(root.findtext(f"Annotations/Annotation[@type='{ANNOTATION}']", ""))
    return meaning if isinstance(meaning, dict) else None


def _value(text: str):
    """What is written, as JSON where it is."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
