"""An FMU as one function from a position to its force, driven as a haptic loop drives it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lumbar.errors import InputError
from lumbar.haptics.simulation import Step


@contextmanager
def fmu_step(path: Path) -> Iterator[Step]:
    """Load an FMU for FMI 3.0 and step it in event mode.

    Parameters
    ----------
    path : Path

    Yields
    ------
    callable
        From a position in the FMU's unit to the force of the same sample; one call is one sample of the model.

    Raises
    ------
    InputError
        If the file is no FMU for FMI 3.0 with one input and one output.
    """
    import fmpy
    from fmpy.fmi3 import FMU3Slave

    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as folder:
        description = _description(path)
        fmpy.extract(str(path), folder)
        references = {item.causality: item.valueReference for item in description.modelVariables}
        instance = FMU3Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="render",
        )
        instance.instantiate(eventModeUsed=True, logMessage=lambda *_: None)
        try:
            instance.enterInitializationMode(startTime=0.0)
            instance.exitInitializationMode()
            yield _stepping(instance, references, sampling_time(description))
        finally:
            instance.freeInstance()


def _description(path: Path):
    import fmpy

    description = fmpy.read_model_description(str(path))
    if not description.fmiVersion.startswith("3"):
        raise InputError(f"{path}: FMI {description.fmiVersion}; take the file for FMI 3.0 of the same model")
    for causality in ("input", "output"):
        count = sum(item.causality == causality for item in description.modelVariables)
        if count != 1:
            raise InputError(f"{path}: it has {count} {causality}s; one position and one force are needed")
    return description


def sampling_time(description) -> float:
    """Seconds between two samples of an FMU that lumbar made."""
    return float(description.coSimulation.fixedInternalStepSize)


def _stepping(instance, references: dict[str, int], period: float) -> Step:
    samples = 0

    def step(position: float) -> float:
        nonlocal samples
        if samples:
            instance.doStep((samples - 1) * period, period)
            instance.enterEventMode()
        instance.setFloat64([references["input"]], [position])
        instance.updateDiscreteStates()
        force = instance.getFloat64([references["output"]])[0]
        instance.enterStepMode()
        samples += 1
        return force

    return step
