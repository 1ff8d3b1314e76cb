"""Every model on the device of a study: analysed, simulated, and from which rate on it is safe."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lumbar.errors import NumericalError
from lumbar.fmu.build.export_model import ExportModel, export_models
from lumbar.fmu.build.linear_model import LinearModel
from lumbar.haptics.analysis import Analysis, analyse, run_loop
from lumbar.haptics.lowest_rate import lowest_rates
from lumbar.haptics.rendered_model import RenderedModel, rendered
from lumbar.haptics.simulation import LoopRun
from lumbar.models.fitted_model import FittedModel
from lumbar.settings.runtime import RuntimeSettings


@dataclass(frozen=True)
class Judgement:
    """A model at one rate on the device of the settings.

    Attributes
    ----------
    model : RenderedModel
    analysis : Analysis
    run : LoopRun
    fitted : FittedModel or None
        None for an FMU.
    lowest_passive_rate, lowest_stable_rate : float or None
        In Hz; None where there is none, or where the model has effects and only its own rate was looked at.
    """

    model: RenderedModel
    analysis: Analysis
    run: LoopRun
    fitted: FittedModel | None = None
    lowest_passive_rate: float | None = None
    lowest_stable_rate: float | None = None


def judge(models: Sequence[FittedModel], settings: RuntimeSettings) -> tuple[list[Judgement], list[str]]:
    """Judge models as they are exported, and at the rate of the servo.

    Parameters
    ----------
    models : sequence of FittedModel
    settings : RuntimeSettings
        Rate, moving average, limit and device.

    Returns
    -------
    list of Judgement
        For each model that of its own rate, or of ``settings.rate_Hz``, then that of the servo.
    list of str
        Why a model is not judged at a rate: it has no counterpart there.

    Raises
    ------
    InputError
        If a model takes no length or gives no force.
    """
    found, refused = [], []
    for model in models:
        own = settings.rate_Hz or 1.0 / model.sampling_time
        rates = lowest_rates(model, settings) if model.discrete else (None, None)
        for rate in dict.fromkeys([own, max(own, settings.device.rate_Hz)]):
            try:
                exported = export_models([model], replace(settings, rate_Hz=rate, unstable="export"))[0]
            except NumericalError as error:
                refused.append(str(error))
                continue
            found.append(_judgement(exported, model, settings, rates))
    return found, list(dict.fromkeys(refused))


def _judgement(exported: ExportModel, model: FittedModel, settings: RuntimeSettings, rates) -> Judgement:
    device = settings.device
    meets = rendered(exported, device)
    linear = isinstance(exported.dynamics, LinearModel)
    run = run_loop(meets, device) if linear else _run_of_fmu(exported, meets, settings)
    return Judgement(meets, analyse(meets, device), run, model, *rates)


def _run_of_fmu(exported: ExportModel, meets: RenderedModel, settings: RuntimeSettings) -> LoopRun:
    """Compile a model with effects and simulate the loop with its FMU: what is felt is what is exported."""
    from lumbar.fmu.build.compiler import cache_folder
    from lumbar.fmu.build.package import export_fmus
    from lumbar.haptics.fmu_step import UnpackedFmu

    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as folder:
        files = export_fmus([exported], Path(folder), "", ["host"], cache_folder(settings.compiler_cache))
        with UnpackedFmu(files[-1]) as fmu, fmu.stepping() as step:
            return run_loop(meets, settings.device, step)


def judge_fmu(path: Path, settings: RuntimeSettings) -> Judgement:
    """Judge an FMU for FMI 3.0 at its own rate.

    Raises
    ------
    InputError
        If the file cannot be rendered.
    """
    from lumbar.haptics.fmu_step import UnpackedFmu

    with UnpackedFmu(path) as fmu:
        meets = fmu.rendered(settings.device)
        with fmu.stepping() as step:
            return Judgement(meets, analyse(meets, settings.device), run_loop(meets, settings.device, step))
