"""``lumbar.render``: models on a haptic device in a person's hand."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lumbar.base.errors import InputError
from lumbar.interface.data_label import NOT_SAID
from lumbar.interface.device import chosen_models
from lumbar.interface.result import Result
from lumbar.settings.runtime import RuntimeSettings
from lumbar.tissue.models.fitted_model import FittedModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lumbar.tables.table import Table
    from lumbar.tissue.haptics.judgement import Judgement


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
    data: str = "",
) -> Rendering:
    """Say what models do on a haptic device in a person's hand: passive, stable, or oscillating.

    Each model is judged as it is exported and at the rate of the servo. The analysis is exact for linear models (passivity of
    a sampled force after Colgate and Schenkel, 1997; poles of the loop with device, hand and hold); models with effects are
    analysed through their linearisations. All are simulated, with the encoder's steps and the limit of the force; those with
    effects as their FMUs.

    Parameters
    ----------
    model : FittedModel, iterable of FittedModel or path
        Of `identify`, `refine` or `diagnose`; a file ``models.json`` or ``refined.json``; or an FMU for FMI 3.0.
    names : iterable of str, optional
        Of a file: models to judge; default the settings', of an error ladder its last one.
    trained_on : str, optional
        Of a file: record the models were identified on; default the only one there is, or the settings'.
    mass_kg, damping_N_s_m : float, optional
        Of the device; default the settings' ``device``.
    rate_Hz : float, optional
        Of the servo loop.
    effect_files : iterable of path, optional
        Of a file: files with effects of your own.
    settings : RuntimeSettings, optional
        Rate of the models, moving average, limit, device.
    data : str
        Words for the source of the data; default those of the file.

    Raises
    ------
    InputError
        A model that is not there, cannot be exported, or takes no length or gives no force.

    Examples
    --------
    >>> import lumbar
    >>> from lumbar.twin.examples import example_records
    >>> found = lumbar.render(lumbar.identify(example_records(), "multisine")["KB"])
    >>> found[0].analysis.stable, found[0].run.oscillates
    (False, True)
    """
    settings = settings or RuntimeSettings()
    given = {
        "mass_kg": mass_kg,
        "damping_N_s_m": damping_N_s_m,
        "hand_stiffness_N_m": hand_stiffness_N_m,
        "rate_Hz": rate_Hz,
    }
    for key, value in given.items():
        if value is not None and not 0 < value < float("inf"):
            raise InputError(f"{key}: {value}, a finite number above 0 is needed")
    values = {key: value for key, value in given.items() if value is not None}
    settings = replace(settings, device=replace(settings.device, **values))  # type: ignore[arg-type]  # no words
    if isinstance(model, str | os.PathLike) and Path(model).suffix == ".fmu":
        from lumbar.tissue.haptics.judgement import judge_fmu

        return Rendering((judge_fmu(Path(model), settings),), (), settings, data or Path(model).name)
    if isinstance(model, str | os.PathLike):
        fitted, read_from = chosen_models(Path(model), settings, names, trained_on, effect_files)
        data = data or read_from
    else:
        fitted = [model] if isinstance(model, FittedModel) else list(model)
    found = rendering_of(fitted, settings, data or NOT_SAID)
    if not len(found):
        raise InputError("\n".join(found.refused))
    return found


def rendering_of(models: Sequence[FittedModel], settings: RuntimeSettings, data: str) -> Rendering:
    """Judge models on the device of the settings; models that cannot be rendered are refused with the reason, not an error."""
    from lumbar.tissue.haptics.judgement import judge

    judgements, refused = judge(models, settings)
    return Rendering(tuple(judgements), tuple(refused), settings, data)


@dataclass(frozen=True, eq=False, repr=False)
class Rendering(Result):
    """What models do on a device."""

    judgements: tuple[Judgement, ...]
    """``analysis`` (damping needed, largest stable gain), ``run`` (the simulated loop) and the lowest safe rates of each
    model at each rate."""
    refused: tuple[str, ...]
    """Why models have no counterpart at a rate."""
    settings: RuntimeSettings
    """With the device."""
    data: str

    def __getitem__(self, index: int) -> Judgement:
        return self.judgements[index]

    def __iter__(self) -> Iterator[Judgement]:
        return iter(self.judgements)

    def __len__(self) -> int:
        return len(self.judgements)

    @property
    def table(self) -> Table:
        """Model × device, with the definition of every number."""
        from lumbar.tissue.haptics.device_table import device_table

        return device_table(self.judgements, self.refused, self.settings, self.data)

    @property
    def linear(self) -> list[FittedModel]:
        """The transfer functions among the models, each once."""
        given = [item.fitted for item in self if item.fitted is not None and item.fitted.discrete]
        return list({model.name: model for model in given}.values())

    def z_width_figure(self) -> Figure:
        """Damping needed against the rate, and the stiffness that the device can render against its damping.

        Raises
        ------
        InputError
            If no model is a transfer function.
        """
        from lumbar.publishing.figures.runtime_figures import z_width_figure
        from lumbar.tissue.haptics.passivity import z_width

        if not self.linear:
            raise InputError("the Z-width needs a model of models.json: none of these is a transfer function")
        return z_width_figure(z_width(self.linear, self.settings), self.settings.device)

    def loop_figure(self) -> Figure:
        """The loop that oscillates beside the mended one, of the best fitting model that has both; else the first two loops."""
        from lumbar.publishing.figures.runtime_figures import loop_figure
        from lumbar.tissue.haptics.judgement import mended

        return loop_figure(mended(self.judgements) or self.judgements[:2])

    def files(self) -> Iterator[tuple[str, Any]]:
        """The table ``rendering`` and the figures ``closed_loop`` and, of transfer functions, ``z_width``."""
        yield "rendering", self.table
        yield "closed_loop", self.loop_figure()
        if self.linear:
            yield "z_width", self.z_width_figure()

    def __repr__(self) -> str:
        return f"<Rendering: {len(self)} loops>"

    def __str__(self) -> str:
        """Device and hand, then one paragraph per loop."""
        from lumbar.tissue.haptics.device_table import device_text

        return "\n".join([device_text(self.settings.device), *map(_told, self), *self.refused])


def _told(item: Judgement) -> str:
    run = item.run
    does = (
        f"simulated, it oscillates at {run.frequency:.3g} Hz with {run.peak_to_peak:.3g} N peak to peak"
        if run.oscillates
        else "simulated, it comes to rest"
    )
    rates = [
        f"{word} from {rate:.4g} Hz on"
        for word, rate in (("stable", item.lowest_stable_rate), ("passive", item.lowest_passive_rate))
        if rate is not None
    ]
    return "; ".join([item.analysis.finding, does, *rates])
