"""An FMU in the loop: stepped as a haptic device steps it, and linearised by what it answers."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from lumbar.tissue.fmu.check.instance import Instance, UnzippedFmu
from lumbar.tissue.fmu.conventions import RATE_LIMIT, slow_push, told_meaning
from lumbar.tissue.haptics.rendered_model import (
    RenderedModel,
    beside,
    in_units,
    linearisations,
    reach_mm,
    scale_of,
    watched,
)
from lumbar.tissue.haptics.simulation import Step
from lumbar.tissue.models.model_data import Port

if TYPE_CHECKING:
    from lumbar.settings.runtime import DeviceSettings


class UnpackedFmu:
    """An FMU for FMI 3.0 of an export, which is unpacked once and instantiated as often as it is played."""

    def __init__(self, path: Path):
        self.path = path

    def __enter__(self) -> UnpackedFmu:
        import fmpy

        self._folder = tempfile.TemporaryDirectory(prefix="lumbar-render-")
        fmpy.extract(str(self.path), self._folder.name)
        self.fmu = UnzippedFmu(Path(self._folder.name))
        return self

    def __exit__(self, *_) -> None:
        self.fmu.slave.freeLibrary()
        self._folder.cleanup()

    @contextmanager
    def stepping(self) -> Iterator[Step]:
        """Instantiate it: a function from a position, in its unit, to the force of the same sample."""
        instance = Instance(self.fmu, event_mode=True)
        try:
            yield instance.sample
        finally:
            instance.free()

    def response(self, positions: np.ndarray) -> np.ndarray:
        """Forces of an instance of its own to positions in its unit; shape (samples,)."""
        with self.stepping() as step:
            return np.array([step(float(position)) for position in positions])

    def rendered(self, device: DeviceSettings) -> RenderedModel:
        """The FMU as the device meets it, through its linearisations where it has effects."""
        fmu, name, step = self.fmu, self.fmu.description.modelName, self.fmu.sampling_time
        position, force = (fmu.variables[port] for port in fmu.ports)
        start = float(position.start)
        at_rest = float(self.response(np.array([start]))[0])
        x, y = (
            Port(item.name, item.unit or "1", offset)
            for item, offset in ((position, start), (force, at_rest))
        )
        unit = 1e3 * scale_of(name, x, y)[0]
        told = told_meaning(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot())
        known = (float(told["lowest"]), float(told["highest"])) if told and "lowest" in told else None
        reach = reach_mm(known, start, unit)
        found = linearisations(
            lambda positions: self.response(start + positions / unit), name, step, device, reach
        )
        loops = [item.scaled(unit) for item in found]
        rendered = in_units(loops, name, x, y, float(force.max), device, self._resistance(told, start))
        limited = any(item.endswith(RATE_LIMIT) for item in fmu.variables)
        still = self.response(np.full(watched(step), start))
        return replace(rendered, reach=reach if len(found) > 1 else None, beside=beside(limited, still))

    def _resistance(self, told: dict | None, start: float) -> float:
        """The sign of `ExportModel.resistance`: what the file tells, of a file without annotation what a push is answered by."""
        if told is None:
            pushed = self.response(start + slow_push(self.fmu.sampling_time))
            return -1.0 if pushed.mean() < pushed[0] else 1.0
        return 1.0 if told.get("prescribed") else float(told["resisting_sign"])
