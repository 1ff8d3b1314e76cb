"""What an exported model does on the device of the study: words for the FMU's page, and a warning or refusal at export."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

from lumbar.base.errors import NumericalError
from lumbar.settings.device import DeviceSettings
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.haptics.analysis import Analysis, analyse
from lumbar.tissue.haptics.device_table import device_text
from lumbar.tissue.haptics.rendered_model import renderable, rendered

_ADVICE = (
    "raise runtime.rate_Hz, export a passive model (runtime/passive_models.json of the study), bound the force "
    "(runtime.device_damping), or take a device with more damping; 'lumbar render' says what helps"
)


def with_device(models: Sequence[ExportModel], device: DeviceSettings) -> list[ExportModel]:
    """Analyse the models on the device, say so in them, and warn of those that are not safe.

    Parameters
    ----------
    device : DeviceSettings
        Its ``unsafe`` says whether an unstable loop is told on standard error or is an error.

    Returns
    -------
    list of ExportModel
        With ``on_device``.

    Raises
    ------
    NumericalError
        A loop is unstable and ``unsafe`` is ``"refuse"``.
    """
    told, unsafe = [], []
    for model in models:
        if not renderable(model):
            told.append(model)
            continue
        sentences = [device_text(device)]
        guarded = model.guards.passive and model.guards.device_damping <= device.damping_N_s_m
        if guarded:
            sentences.append(
                "The bound by device_damping, which the following leaves out, keeps the device passive whatever they say."
            )
        for client, late in (
            ("In FMI 3.0's event mode", False),
            ("Read as FMI 2.0 reads, the position set after", True),
        ):
            found = analyse(rendered(model, device, late=late), device)
            sentences.append(f"{client}: {found.finding}.")
            if not (found.stable or late or guarded):
                unsafe.append(found)
        told.append(replace(model, on_device=tuple(sentences)))
    _tell(unsafe, device)
    return told


def _tell(unsafe: list[Analysis], device: DeviceSettings) -> None:
    if not unsafe:
        return
    text = "\n".join(f"  {found.finding}" for found in unsafe)
    if device.unsafe == "refuse":
        raise NumericalError(
            f"not safe on the device of runtime.device, not exported:\n{text}\n{_ADVICE}, or say runtime.device.unsafe: warn"
        )
    print(f"WARNING: not safe on the device of runtime.device:\n{text}\n  {_ADVICE}", file=sys.stderr)
