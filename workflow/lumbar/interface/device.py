"""``lumbar.export_fmu`` and ``lumbar.load_models``: models for the haptic runtime, and models from files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from lumbar.interface.data_label import NOT_SAID
from lumbar.settings.runtime import Platform, RuntimeSettings
from lumbar.tissue.models.fitted_model import FittedModel


def load_models(path: str | os.PathLike, effect_files: Iterable[str | os.PathLike] = ()) -> list[FittedModel]:
    """Read ``models.json`` or ``refined.json``.

    Parameters
    ----------
    path : path
    effect_files : iterable of path, optional
        Files with effects of your own that the models have.

    Raises
    ------
    InputError
        With the place of everything that is missing, unknown or of the wrong type.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> lumbar.refine(example_records(), ["coulomb_friction"]).save("refined")
    >>> [model.name for model in lumbar.load_models("refined/refined.json")]
    ['KB', 'KB+coulomb_friction']
    """
    return _read(Path(path), effect_files)[0]


def _read(path: Path, effect_files) -> tuple[list[FittedModel], str]:
    from lumbar.base.files import read_json
    from lumbar.tissue.effects.catalogue import catalogues_with
    from lumbar.tissue.models.fitted_model import read_models

    content = read_json(path)
    models = read_models(content, catalogues_with(list(effect_files)))
    return models, content.get("data") or path.name


def export_fmu(
    model: FittedModel | Iterable[FittedModel] | str | os.PathLike,
    folder: str | os.PathLike,
    names: Iterable[str] | None = None,
    *,
    trained_on: str | None = None,
    rate_Hz: float | None = None,
    targets: Iterable[Platform] | None = None,
    effect_files: Iterable[str | os.PathLike] = (),
    settings: RuntimeSettings | None = None,
    data: str = "",
) -> list[Path]:
    """Export models as FMUs for FMI 2.0 and 3.0, and check each file as `check_fmu` does.

    Parameters
    ----------
    model : FittedModel, iterable of FittedModel or path
        Of `identify`, `refine` or `diagnose`; or a file ``models.json`` or ``refined.json``.
    folder : path
    names : iterable of str, optional
        Of a file: models to export; default the settings', of an error ladder its last one.
    trained_on : str, optional
        Of a file: record the models were identified on; default the only one there is, or the settings'.
    rate_Hz : float, optional
        Rate of the haptic loop in hertz; default the settings': 1 kHz, or with None there that of the model.
    targets : iterable of str, optional
        Platforms to build for: ``host``, ``x86_64-windows`` …; default the settings'.
    effect_files : iterable of path, optional
        Of a file: files with effects of your own.
    settings : RuntimeSettings, optional
        Moving average, limits, guards of the force, what to do with an unstable model, the compiler's cache.
    data : str
        Words for the source of the data; they stand in the FMU. Default those of the file.

    Returns
    -------
    list of pathlib.Path
        ``<model>_fmi2.fmu`` and ``<model>_fmi3.fmu`` of each model.

    Raises
    ------
    InputError
        A model that is not there or cannot be exported, an unknown platform, or a file with a problem: it is removed.
    NumericalError
        An unstable model, or one that is unstable on the settings' device, where the settings refuse it.

    Examples
    --------
    >>> import lumbar
    >>> lumbar.export_fmu("refined/refined.json", "fmu", rate_Hz=1000)  # doctest: +SKIP
    [PosixPath('fmu/KB+coulomb_friction_fmi2.fmu'), PosixPath('fmu/KB+coulomb_friction_fmi3.fmu')]
    """
    from lumbar.tissue.fmu.build.compiler import cache_folder
    from lumbar.tissue.fmu.build.export_model import export_models
    from lumbar.tissue.fmu.build.package import export_fmus
    from lumbar.tissue.fmu.check.file_check import check_new_files
    from lumbar.tissue.haptics.device_table import with_device

    settings = settings or RuntimeSettings()
    settings = replace(
        settings, rate_Hz=rate_Hz or settings.rate_Hz, targets=tuple(targets or settings.targets)
    )
    if isinstance(model, str | os.PathLike):
        selected, read_from = chosen_models(Path(model), settings, names, trained_on, effect_files)
        chosen = export_models(selected, settings)
        data = data or read_from
    else:
        chosen = export_models([model] if isinstance(model, FittedModel) else list(model), settings)
    cache = cache_folder(settings.compiler_cache)
    asked = with_device(chosen, settings.device)
    written = export_fmus(asked, Path(folder), data or NOT_SAID, settings.targets, cache)
    check_new_files(written, cache)
    return written


def chosen_models(
    path: Path, settings: RuntimeSettings, names, trained_on: str | None, effect_files
) -> tuple[list[FittedModel], str]:
    """Models of a file that are meant, and words for the source of its data; parameters and errors as of `export_fmu`."""
    from lumbar.tissue.fmu.build.export_model import find_models

    fitted, read_from = _read(path, effect_files)
    return find_models(fitted, _chosen(settings, fitted, names, trained_on)), read_from


def _chosen(settings: RuntimeSettings, fitted: list[FittedModel], names, trained_on) -> RuntimeSettings:
    """The settings with what is given, or what the file leaves no choice of, before what they say."""
    records = {model.trained_on for model in fitted} - {None}
    only = records.pop() if len(records) == 1 else None
    # Of an error ladder, which holds no discrete model, the last model is what a user wants.
    continuous = not any(model.discrete for model in fitted)
    names = tuple(names or ([fitted[-1].name] if continuous else settings.models))
    # A file of passive fits holds no other.
    estimators = {model.estimator for model in fitted if model.discrete and model.trained_on}
    estimator = estimators.pop() if len(estimators) == 1 else settings.estimator
    return replace(
        settings,
        trained_on=trained_on or only or settings.trained_on,
        models=names,
        estimator=estimator,  # type: ignore[arg-type]  # one that no study can name
    )
