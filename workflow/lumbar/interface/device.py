"""``lumbar.load_models``, ``export_fmu``, ``export_prony`` and ``render``: models outside the project."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.base.files import read_json, write_text
from lumbar.interface.result import UNKNOWN_SOURCE, Result
from lumbar.settings.runtime import Platform, RuntimeSettings
from lumbar.tables.table import Table
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.fmu.build.compiler import cache_folder, resolve_targets
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, export_models, find_models
from lumbar.tissue.haptics.device_table import device_table, device_text, judge_on_device
from lumbar.tissue.haptics.loop_verdict import LoopVerdict, judge_models
from lumbar.tissue.haptics.z_width import z_width
from lumbar.tissue.models.fitted_model import FittedModel, read_models

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def load_models(path: str | os.PathLike, effect_files: Iterable[str | os.PathLike] = ()) -> list[FittedModel]:
    """Read ``models.json`` or ``refined.json``.

    Parameters
    ----------
    path : path
        A file that `Identification.save` or `Refinement.save` wrote.
    effect_files : iterable of path, optional
        Files with user-defined effects in Python, which `path` does not contain.

    Raises
    ------
    InputError
        If entries of the file are missing, unknown or of a wrong type, with the place of each.

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
    content = read_json(path)
    models = read_models(content, catalogues_with(list(effect_files), content), str(path))
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
    source_label: str = "",
) -> list[Path]:
    """Export models as FMUs for FMI 2.0 and 3.0, and validate each file with fmpy.

    Parameters
    ----------
    model : FittedModel, iterable of FittedModel or path
        Result of `identify`, `refine` or `diagnose`; or a file ``models.json`` or ``refined.json``.
    folder : path
        Folder of the written files.
    names : iterable of str, optional
        Models to export from a file. Default: the models of the settings, or the last model of an error ladder.
    trained_on : str, optional
        Record on which the models of a file were identified. Default: the only record, or the record of the settings.
    rate_Hz : float, optional
        Rate of the haptic loop in hertz; default the settings' rate (1 kHz), or the model's rate if the settings have None.
    targets : iterable of str, optional
        Platforms to build for: ``host``, ``x86_64-windows`` …; default the settings'.
    effect_files : iterable of path, optional
        Files with user-defined effects, if `model` is a file.
    settings : RuntimeSettings, optional
        Moving average, limits and guards of the force, treatment of unstable models, the compiler's cache.
    source_label : str
        Name of the source of the data, written into the FMU. Default: the file's.

    Returns
    -------
    list of pathlib.Path
        ``<model>_fmi2.fmu`` and ``<model>_fmi3.fmu`` of each model.

    Raises
    ------
    InputError
        If a model does not exist or cannot be exported, a platform is unknown, or a written file is invalid; all written
        files are then removed.
    NumericalError
        If a model is unstable, by itself or on the device of the settings, and the settings reject it.

    Examples
    --------
    >>> import lumbar
    >>> lumbar.export_fmu("refined/refined.json", "fmu", rate_Hz=1000)  # doctest: +SKIP
    [PosixPath('fmu/KB+coulomb_friction_fmi2.fmu'), PosixPath('fmu/KB+coulomb_friction_fmi3.fmu')]
    """
    from lumbar.tissue.fmu.build.package import export_fmus
    from lumbar.tissue.fmu.fmu_check import validate_new_files

    settings = settings or RuntimeSettings()
    targets = tuple(targets or settings.targets)
    settings = settings.model_copy(update={"rate_Hz": rate_Hz or settings.rate_Hz, "targets": targets})
    selected, read_from = _select_models(model, settings, names, trained_on, effect_files)
    cache = cache_folder(settings.compiler_cache)
    resolve_targets(targets)  # reports a wrong target before the models are judged
    exported = judge_on_device(export_models(selected, settings), settings, selected)
    written = export_fmus(exported, Path(folder), source_label or read_from, targets, cache)
    validate_new_files(written)
    return written


def export_prony(
    model: FittedModel | Iterable[FittedModel] | str | os.PathLike,
    folder: str | os.PathLike,
    names: Iterable[str] | None = None,
    *,
    trained_on: str | None = None,
    effect_files: Iterable[str | os.PathLike] = (),
    settings: RuntimeSettings | None = None,
) -> list[Path]:
    """Write the relaxation of linear and quasi-linear models as Prony series for FEBio and Abaqus.

    Parameters
    ----------
    model, names, trained_on, effect_files
        See `export_fmu`.
    folder : path
        Folder of the written files.
    settings : RuntimeSettings, optional
        Models to export from a file, if it has several.

    Returns
    -------
    list of pathlib.Path
        ``<model>_febio.xml`` and ``<model>_abaqus.inp`` of each model.

    Raises
    ------
    InputError
        If a model does not exist or has no Prony series.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> lumbar.export_prony(lumbar.refine(example_records(), []).model, "prony")
    [PosixPath('prony/KB_febio.xml'), PosixPath('prony/KB_abaqus.inp')]
    """
    from lumbar.tissue.models.prony import prony_series

    selected, _ = _select_models(model, settings or RuntimeSettings(), names, trained_on, effect_files)
    written = []
    for series in [prony_series(item) for item in selected]:
        texts = {"febio.xml": series.febio(), "abaqus.inp": series.abaqus()}
        for ending, text in texts.items():
            written.append(Path(folder) / f"{series.model.name}_{ending}")
            write_text(written[-1], text)
    return written


def _select_models(
    model, settings: RuntimeSettings, names, trained_on: str | None, effect_files
) -> tuple[list[FittedModel], str]:
    """Return the given models, or the models of a file, and the name of their source. Parameters: see `export_fmu`."""
    if not isinstance(model, str | os.PathLike):
        return [model] if isinstance(model, FittedModel) else list(model), UNKNOWN_SOURCE
    fitted, read_from = _read(Path(model), effect_files)
    # A file may leave no choice: one training record, one estimator (passive fits), or an error ladder, which has no discrete
    # model and ends with the default one.
    records = {item.trained_on for item in fitted} - {None}
    estimators = {item.estimator for item in fitted if item.discrete and item.trained_on}
    is_ladder = not any(item.discrete for item in fitted)
    choice = {
        "trained_on": trained_on or (records.pop() if len(records) == 1 else settings.trained_on),
        "models": tuple(names or ([fitted[-1].name] if is_ladder else settings.models)),
        "estimator": estimators.pop() if len(estimators) == 1 else settings.estimator,
    }
    return find_models(fitted, settings.model_copy(update=choice)), read_from


def render(
    model: FittedModel | Iterable[FittedModel] | str | os.PathLike,
    names: Iterable[str] | None = None,
    *,
    trained_on: str | None = None,
    mass_kg: float | None = None,
    damping_N_s_m: float | None = None,
    hand_stiffness_N_m: float | None = None,
    rate_Hz: float | None = None,
    effect_files: Iterable[str | os.PathLike] = (),
    settings: RuntimeSettings | None = None,
    source_label: str = "",
) -> Rendering:
    """Judge models on a haptic device in a subject's hand: passive, stable, or unstable.

    Each model is judged as it is exported and at the rate of the servo. The analysis is exact for linear models (passivity of
    a sampled force after Colgate and Schenkel, 1997; poles of the loop with device, hand and hold); models with effects are
    analysed through their linearisations. All models are simulated with the encoder's steps and the limit of the force;
    models with effects are simulated as FMUs.

    Parameters
    ----------
    model : FittedModel, iterable of FittedModel or path
        Result of `identify`, `refine` or `diagnose`; or a file ``models.json`` or ``refined.json``.
    names, trained_on, effect_files, source_label
        See `export_fmu`.
    mass_kg, damping_N_s_m, hand_stiffness_N_m, rate_Hz : float, optional
        Values of the device, the hand and the servo loop; default the settings' ``device``.
    settings : RuntimeSettings, optional
        Rate of the models, moving average, limit, device.

    Raises
    ------
    InputError
        If a model does not exist, cannot be exported, or does not turn a length into a force.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> rendering = lumbar.render(lumbar.identify(example_records(), "multisine")["KB"])
    >>> rendering[0].analysis.stable, rendering[0].run.oscillates
    (False, True)
    """
    settings = settings or RuntimeSettings()
    given = {"mass_kg": mass_kg, "damping_N_s_m": damping_N_s_m, "rate_Hz": rate_Hz}
    given["hand_stiffness_N_m"] = hand_stiffness_N_m
    values = {key: value for key, value in given.items() if value is not None}
    for key, value in values.items():
        may_be_zero = key == "hand_stiffness_N_m"  # a stylus without a hand
        if not (0 < value < float("inf") or (value == 0 and may_be_zero)):
            allowed = "of 0 or more" if may_be_zero else "above 0"
            raise InputError(f"{key}: {value}, a finite number {allowed} is needed")
    settings = settings.model_copy(update={"device": settings.device.model_copy(update=values)})
    fitted, read_from = _select_models(model, settings, names, trained_on, effect_files)
    rendering = judge_rendering(fitted, settings, source_label or read_from)
    if not len(rendering):
        raise InputError("\n".join(rendering.refused))
    return rendering


def judge_rendering(models: Sequence[FittedModel], settings: RuntimeSettings, source_label: str) -> Rendering:
    """Judge models on the device of the settings; the result lists models that cannot be judged, with reasons.

    Parameters
    ----------
    models : sequence of FittedModel
        Models of a tissue.
    settings : RuntimeSettings
        Device, hands and rates.
    source_label : str
        Name of the source of the data.
    """
    verdicts, reasons = judge_models(models, settings)
    return Rendering(tuple(verdicts), tuple(reasons), settings, source_label)


@dataclass(frozen=True, eq=False, repr=False)
class Rendering(Result):
    """Verdicts on models on a device."""

    judgements: tuple[LoopVerdict, ...]
    """``analysis`` (damping needed, largest stable gain), ``run`` (the simulated loop), the worst hand and the lowest safe
    rates of each model at each rate."""
    refused: tuple[str, ...]
    """Messages on models that cannot be converted to a rate."""
    settings: RuntimeSettings
    """Settings with the device."""
    source_label: str

    def __getitem__(self, index: int) -> LoopVerdict:
        return self.judgements[index]

    def __iter__(self) -> Iterator[LoopVerdict]:
        return iter(self.judgements)

    def __len__(self) -> int:
        return len(self.judgements)

    @property
    def table(self) -> Table:
        """Table of all models on all devices, with the definition of every number."""
        return device_table(self.judgements, self.refused, self.settings, self.source_label)

    @property
    def linear(self) -> list[FittedModel]:
        """Transfer functions among the models, without duplicates and models as in the thesis, which have only one rate."""
        given = [item.fitted for item in self if item.fitted is not None and item.fitted.discrete]
        return list({model.name: model for model in given if not model.name.endswith(AS_IN_THESIS)}.values())

    def z_width_figure(self) -> Figure:
        """Draw the required damping over the rate, and the largest stiffness that the device can render over its damping.

        Raises
        ------
        InputError
            If no model is a transfer function.
        """
        from lumbar.publishing.figures.runtime_figures import z_width_figure

        if not self.linear:
            raise InputError("the Z-width needs a model of models.json: none of these is a transfer function")
        return z_width_figure(z_width(self.linear, self.settings), self.settings.device)

    def loop_figure(self) -> Figure:
        """Draw an oscillating and a calm loop of one model, the best-fitting with both; otherwise the first two loops."""
        from lumbar.publishing.figures.runtime_figures import loop_figure

        def fit(pair: Sequence[LoopVerdict]) -> float:
            fitted = pair[0].fitted
            return (fitted and fitted.scores.vaf_percent) or 0.0

        oscillating = [item for item in self if item.run.oscillates]
        calm = [item for item in self if not item.run.oscillates]
        pairs = [(one, other) for one in oscillating for other in calm if one.model.name == other.model.name]
        return loop_figure(max(pairs, key=fit, default=self.judgements[:2]))

    def files(self) -> Iterator[tuple[str, Any]]:
        """Return the table ``rendering`` and the figures ``closed_loop`` and, for transfer functions, ``z_width``."""
        yield "rendering", self.table
        yield "closed_loop", self.loop_figure()
        if self.linear:
            yield "z_width", self.z_width_figure()

    def __repr__(self) -> str:
        return f"<Rendering: {len(self)} loops>"

    def __str__(self) -> str:
        """Text on device and hand, then one paragraph per loop."""
        lines = [device_text(self.settings.device)]
        for item in self:
            rates = {"stable": item.lowest_stable_rate, "passive": item.lowest_passive_rate}
            known = [f"{name} from {rate:.4g} Hz on" for name, rate in rates.items() if rate is not None]
            lines.append("; ".join([item.finding, *known]))
        return "\n".join([*lines, *self.refused])
