"""An FMU in the loop: stepped as a haptic device steps it, and linearised by what it answers."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from lumbar.base.errors import InputError
from lumbar.tissue.fmu.conventions import RATE_LIMIT, slow_push, told_meaning
from lumbar.tissue.haptics.rendered_model import RenderedModel, in_units, linearisations, reach_mm, scale_of
from lumbar.tissue.haptics.simulation import Step
from lumbar.tissue.models.model_data import Port

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

    from lumbar.settings.runtime import DeviceSettings


class UnpackedFmu:
    """An FMU for FMI 3.0 that is unpacked once and instantiated as often as it is played.

    Raises
    ------
    InputError
        If it is no FMU for FMI 3.0 with event mode, one position and one force.
    """

    def __init__(self, path: Path):
        self.path = path
        self.description = _description(path)
        # Position and force come first; energies may follow.
        self.variables = {
            item.causality: item
            for item in reversed(self.description.modelVariables)
            if item.causality in ("input", "output")
        }
        self.sampling_time = float(self.description.coSimulation.fixedInternalStepSize)

    def __enter__(self) -> UnpackedFmu:
        import fmpy

        self._closing = ExitStack()
        self.folder = self._closing.enter_context(tempfile.TemporaryDirectory(prefix="lumbar-render-"))
        fmpy.extract(str(self.path), self.folder)
        return self

    def __exit__(self, *_) -> None:
        self._closing.close()

    @contextmanager
    def stepping(self) -> Iterator[Step]:
        """Instantiate it: a function from a position, in its unit, to the force of the same sample."""
        from fmpy.fmi3 import FMU3Slave

        instance = FMU3Slave(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="render",
        )
        instance.instantiate(eventModeUsed=True, logMessage=lambda *_: None)
        try:
            instance.enterInitializationMode(startTime=0.0)
            instance.exitInitializationMode()
            yield self._step(instance)
        finally:
            instance.freeInstance()

    def _step(self, instance) -> Step:
        position, force = ([self.variables[kind].valueReference] for kind in ("input", "output"))
        samples = 0

        def step(given: float) -> float:
            nonlocal samples
            if samples:
                instance.doStep((samples - 1) * self.sampling_time, self.sampling_time)
                instance.enterEventMode()
            instance.setFloat64(position, [given])
            instance.updateDiscreteStates()
            found = instance.getFloat64(force)[0]
            instance.enterStepMode()
            samples += 1
            return found

        return step

    def response(self, positions: np.ndarray) -> np.ndarray:
        """Forces of an instance of its own to positions in its unit; shape (samples,)."""
        with self.stepping() as step:
            return np.array([step(float(position)) for position in positions])

    def rendered(self, device: DeviceSettings) -> RenderedModel:
        """The FMU as the device meets it, through its linearisations where it has effects."""
        given = self.variables["input"], self.variables["output"]
        start = float(given[0].start)
        at_rest = float(self.response(np.array([start]))[0])
        x, y = (
            Port(item.name, item.unit or "1", offset)
            for item, offset in zip(given, (start, at_rest), strict=True)
        )
        name, unit = self.description.modelName, 1e3 * scale_of(self.description.modelName, x, y)[0]
        told = told_meaning(ElementTree.parse(Path(self.folder) / "modelDescription.xml").getroot())
        known = (float(told["lowest"]), float(told["highest"])) if told and "lowest" in told else None
        reach = reach_mm(known, start, unit)
        found = linearisations(
            lambda positions: self.response(start + positions / unit), name, self.sampling_time, device, reach
        )
        loops = [item.scaled(unit) for item in found]
        rendered = in_units(loops, name, x, y, float(given[1].max), device, self._resistance(told, start))
        limited = any(item.name.endswith(RATE_LIMIT) for item in self.description.modelVariables)
        return replace(rendered, reach=reach if len(found) > 1 else None, rate_limited=limited)

    def _resistance(self, told: dict | None, start: float) -> float:
        """The sign of `ExportModel.resistance`: what the file tells, of a file without annotation what a push is answered by."""
        if told is None:
            pushed = self.response(start + slow_push(self.sampling_time))
            return -1.0 if pushed.mean() < pushed[0] else 1.0
        return 1.0 if told.get("prescribed") else float(told["resisting_sign"])


def check_rendered(path: Path) -> None:
    """Look for a file that can be none for FMI 3.0.

    Raises
    ------
    InputError
        If it is not there, or is one for FMI 2.0.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; 'lumbar export' makes <model>_fmi3.fmu")


def _description(path: Path) -> ModelDescription:
    import fmpy

    check_rendered(path)
    description = fmpy.read_model_description(str(path))
    version = description.fmiVersion
    if not version.startswith("3"):
        raise InputError(
            f"{path}: FMI {version}; take the file for FMI 3.0 of the same model, <model>_fmi3.fmu"
        )
    simulation = description.coSimulation
    if simulation is None or not simulation.hasEventMode or not simulation.fixedInternalStepSize:
        raise InputError(f"{path}: no sampled model with event mode; FMUs of 'lumbar export' are")
    for causality, needed in (("input", "position"), ("output", "force")):
        if not any(item.causality == causality for item in description.modelVariables):
            raise InputError(f"{path}: it has no {causality}; a {needed} is needed")
    return description
