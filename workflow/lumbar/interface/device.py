"""``lumbar.export_fmu``: models for the haptic runtime."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from lumbar.models.fitted_model import FittedModel
from lumbar.settings.runtime import RuntimeSettings


def export_fmu(
    model: FittedModel | Iterable[FittedModel],
    folder: str | os.PathLike,
    *,
    rate_Hz: float | None = None,
    targets: Iterable[str] | None = None,
    settings: RuntimeSettings | None = None,
    data: str = "",
) -> list[Path]:
    """Export models as FMUs for FMI 2.0 and 3.0.

    Parameters
    ----------
    model : FittedModel or iterable of FittedModel
        Of `identify`, `refine` or `diagnose`.
    folder : path
    rate_Hz : float, optional
        Rate of the haptic loop in hertz; default the settings', or that of the model.
    targets : iterable of str, optional
        Platforms to build for: ``host``, ``x86_64-windows`` …; default the settings'.
    settings : RuntimeSettings, optional
        Moving average, limits, what to do with an unstable model, the compiler's cache.
    data : str
        Words for the source of the data; they stand in the FMU.

    Returns
    -------
    list of pathlib.Path
        ``<model>_fmi2.fmu`` and ``<model>_fmi3.fmu`` of each model.

    Raises
    ------
    InputError
        A model that cannot be exported, or an unknown platform.
    NumericalError
        An unstable model, where the settings refuse it.
    """
    from lumbar.fmu.build.compiler import cache_folder
    from lumbar.fmu.build.export_model import export_models
    from lumbar.fmu.build.package import export_fmus

    models = [model] if isinstance(model, FittedModel) else list(model)
    settings = settings or RuntimeSettings()
    settings = replace(
        settings, rate_Hz=rate_Hz or settings.rate_Hz, targets=tuple(targets or settings.targets)
    )
    chosen = export_models(models, settings)
    return export_fmus(chosen, Path(folder), data, settings.targets, cache_folder(settings.compiler_cache))
