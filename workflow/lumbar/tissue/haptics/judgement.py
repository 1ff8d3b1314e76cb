"""Every model on the device of a study: analysed, simulated, and from which rate on it is safe."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.haptics.analysis import Analysis, analyse, run_loop
from lumbar.tissue.haptics.lowest_rate import lowest_rates
from lumbar.tissue.haptics.rendered_model import RenderedModel, exported_at, rendered, scale_of
from lumbar.tissue.haptics.simulation import LoopRun
from lumbar.tissue.models.fitted_model import FittedModel


@dataclass(frozen=True)
class Judgement:
    """A model at one rate on the device of the settings."""

    model: RenderedModel
    analysis: Analysis
    run: LoopRun
    fitted: FittedModel | None = None
    """None for an FMU."""
    lowest_passive_rate: float | None = None
    lowest_stable_rate: float | None = None
    """`lowest_passive_rate`, `lowest_stable_rate`: in Hz; None where there is none, or where the model has effects and
    only its own rate was looked at."""


def judge(models: Sequence[FittedModel], settings: RuntimeSettings) -> tuple[list[Judgement], list[str]]:
    """Judge models as they are exported, and at the rate of the servo.

    Parameters
    ----------
    settings : RuntimeSettings
        Rate, moving average, limit and device.

    Returns
    -------
    list of Judgement
        For each model that of the rate it was identified at, that of ``settings.rate_Hz`` and that of the servo.
    list of str
        Why a model is not judged, or not at a rate: it takes no length, or has no counterpart there.

    Raises
    ------
    InputError
        If a model cannot be exported.
    """
    found, refused = [], []
    for model in models:
        try:
            scale_of(model.name, model.input, model.output)
        except InputError as error:
            refused.append(str(error))
            continue
        identified = 1.0 / model.sampling_time
        own = settings.rate_Hz or identified
        lowest = lowest_rates(model, settings) if model.discrete else (None, None)
        for rate in sorted({identified, own, max(identified, settings.device.rate_Hz)}):
            try:
                exported = exported_at(model, settings, rate)
            except NumericalError as error:
                refused.append(str(error))
            else:
                found.append(_judgement(exported, model, settings, lowest))
    return found, list(dict.fromkeys(refused))


def _judgement(exported: ExportModel, model: FittedModel, settings: RuntimeSettings, lowest) -> Judgement:
    device = settings.device
    meets = rendered(exported, device)
    guards = exported.guards
    plain = isinstance(exported.dynamics, LinearModel) and not (guards.active or guards.contact)
    run = run_loop(meets, device) if plain else _run_of_fmu(exported, meets, settings)
    return Judgement(meets, analyse(meets, device), run, model, *lowest)


def _run_of_fmu(exported: ExportModel, meets: RenderedModel, settings: RuntimeSettings) -> LoopRun:
    """Compile a model with effects or guards and simulate the loop with its FMU: what is felt is what is exported."""
    from lumbar.tissue.fmu.build.compiler import cache_folder
    from lumbar.tissue.fmu.build.package import export_fmus
    from lumbar.tissue.haptics.fmu_step import UnpackedFmu

    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as folder:
        cache = cache_folder(settings.compiler_cache)
        (file,) = export_fmus([exported], Path(folder), "", ["host"], cache, versions=["3.0"])
        with UnpackedFmu(file) as fmu, fmu.stepping() as step:
            return run_loop(meets, settings.device, step)


def judge_fmu(path: Path, settings: RuntimeSettings) -> Judgement:
    """Judge an FMU for FMI 3.0 at its own rate.

    Raises
    ------
    InputError
        If the file cannot be rendered.
    """
    from lumbar.tissue.haptics.fmu_step import UnpackedFmu

    with UnpackedFmu(path) as fmu:
        meets = fmu.rendered(settings.device)
        with fmu.stepping() as step:
            return Judgement(meets, analyse(meets, settings.device), run_loop(meets, settings.device, step))


def mended(judgements: Sequence[Judgement]) -> tuple[Judgement, Judgement] | None:
    """A loop that oscillates and one of the same model at another rate that does not; of the model that fits best."""
    pairs = [
        (before, after)
        for before in judgements
        for after in judgements
        if before.analysis.name == after.analysis.name and before.run.oscillates and not after.run.oscillates
    ]

    def fit(pair: tuple[Judgement, Judgement]) -> float:
        fitted = pair[0].fitted
        return (fitted and fitted.scores.vaf_percent) or 0.0

    return max(pairs, key=fit, default=None)
