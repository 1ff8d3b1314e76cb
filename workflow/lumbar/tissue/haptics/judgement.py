"""Models on a device in a hand: damping needed, largest stable gain, the loop in time, and from which rate on each is safe."""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.base.files import parsed_json
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.effects.catalogue import catalogues_with
from lumbar.tissue.fmu.build.compiler import cache_folder
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.record import read_record
from lumbar.tissue.fmu.conventions import RECORD
from lumbar.tissue.haptics.closed_loop import SampledModel, largest_stable_gain
from lumbar.tissue.haptics.held_force import felt_on_device
from lumbar.tissue.haptics.in_space import judge_in_space
from lumbar.tissue.haptics.passivity import lowest_rates, required_damping
from lumbar.tissue.haptics.rendered_model import (
    RenderedModel,
    UnpackedFmu,
    export_at,
    fmu_of,
    render_model,
    scale_of,
    unpacked,
)
from lumbar.tissue.haptics.simulation import (
    PUSH_MM,
    PUSHES_MM,
    LoopRun,
    TissueForce,
    difference_equation,
    encoder_ripple,
    one_step,
    simulate,
)
from lumbar.tissue.haptics.stable_share import stable_share
from lumbar.tissue.haptics.ticks.sequence import PeriodicModel, in_ticks
from lumbar.tissue.haptics.verdict import Analysis, Judgement
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.perception.thresholds import Hands

MOST_STATES = 400
"""Of a loop whose response to errors of the encoder is followed; longer ones, kept as impulse responses, are not."""


def analyse(model: RenderedModel, device: DeviceSettings) -> Analysis:
    """Analyse the loop of a model, or of all its linearisations."""
    damping = max(map(required_damping, model.loops))
    gains = [largest_stable_gain(item, device) for item in model.loops]
    gain = min(gains)
    loop = model.loops[gains.index(gain)].name
    rate = 1.0 / model.sampled[0].sampling_time
    found = Analysis(model.name, rate, device, damping, *gain, loop, tuple(each for each, _ in gains))
    found = replace(found, reach=model.reach, beside=model.beside)
    if not model.timings:
        return found
    return replace(
        found,
        timings=sum(item.tried for item in model.timings),
        even_gain=min(gains[: -len(model.timings)])[0],
        proved_gain=min(item.proved for item in model.timings),
    )


def run_loop(
    model: RenderedModel,
    device: DeviceSettings,
    force_of: Callable[[float], float] | None = None,
    push_mm: float = PUSH_MM,
    gains: Sequence[float] = (),
) -> LoopRun:
    """Simulate a push into the model and what follows.

    Parameters
    ----------
    force_of : callable, optional
        From a position to its force in the model's units, sample by sample: the FMU itself. A model with effects needs it;
        a linear one is simulated by its difference equation without it.
    gains : sequence of float
        Largest stable gains of the loops, where they are known.
    """
    gains = gains or analyse(model, device).gains
    return _pushed(model, device, *_expected(model, device, gains), force_of, push_mm)


def _expected(
    model: RenderedModel, device: DeviceSettings, gains: Sequence[float]
) -> tuple[PeriodicModel, float]:
    """The loop whose ticks are taken, and the ripple of `LoopRun`."""
    # Ticks are alike, or the worst there may be.
    ticks = in_ticks(model.loops[int(np.argmin(gains))])
    # In a stable loop the encoder's steps may go on wherever it comes to rest: at rest too, where an effect may be stiffest.
    even = model.loops[: len(model.loops) - len(model.timings)]
    few = [item for item in map(in_ticks, even) if len(item.states[0]) <= MOST_STATES]
    if min(gains) > 1.0 and few:
        return ticks, max(encoder_ripple(item, device) for item in few)
    return ticks, max(one_step(item, device) for item in model.of_large_motion)


def _pushed(
    model: RenderedModel,
    device: DeviceSettings,
    ticks: PeriodicModel,
    ripple: float,
    force_of: Callable[[float], float] | None,
    push_mm: float,
) -> LoopRun:
    """The run of `run_loop` where ticks and ripple are known."""
    sampled = model.sampled[0]
    step = difference_equation(sampled) if force_of is None else model.in_loop(force_of)
    tick = TissueForce(step, sampled.sampling_time)
    delay = 1e-3 * device.delay_ms
    return simulate(tick, ticks.ticks(), device, model.limit, delay=delay, ripple=ripple, push_mm=push_mm)


def judge(
    models: Sequence[FittedModel], settings: RuntimeSettings, hands: Hands | None = None
) -> tuple[list[Judgement], list[str]]:
    """Judge models as they are exported and at the rate of the servo, and what `hands` feel of it (default the literature's).

    Returns
    -------
    list of Judgement
        For each model that of the rate it was identified at, that of ``settings.rate_Hz`` and that of the servo; of one as
        the thesis ran it the first alone.
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
        fixed = model.name.endswith(AS_IN_THESIS)
        rates = {identified} if fixed else {identified, own, max(identified, settings.device.rate_Hz)}
        lowest = lowest_rates(model, settings) if model.discrete and not fixed else (None, None)
        for rate in sorted(rates):
            try:
                exported = export_at(model, settings, rate)
            except NumericalError as error:
                refused.append(str(error))
            else:
                passive, stable = lowest
                judged = judge_exported(exported, settings, model)
                felt = felt_on_device(exported, model, settings, hands or Hands.of())
                rates = {"lowest_passive_rate": passive, "lowest_stable_rate": stable}
                found.append(replace(judged, **rates, felt=felt))
    return found, list(dict.fromkeys(refused))


def judge_exported(
    exported: ExportModel,
    settings: RuntimeSettings,
    fitted: FittedModel | None = None,
    file: Path | None = None,
) -> Judgement:
    """Judge a model as it is exported, a linear one by its difference equation, others with the FMU itself in the loop.

    `fitted` is what it was exported from: intervals of its parameters count. `file` is its FMU, where there is one.
    """
    if exported.axes:
        return judge_in_space(exported, settings, fitted, file)
    device = settings.device
    meets = render_model(exported, device)
    hands = stable_share(meets, exported.moving_average, fitted, device)
    analysis = analyse(meets, device)
    guards = exported.guards
    if isinstance(exported.dynamics, LinearModel) and not (guards.active or guards.contact):
        return Judgement(meets, analysis, run_loop(meets, device, gains=analysis.gains), fitted, hands)
    with fmu_of(exported, settings, file) as fmu:
        return Judgement(meets, analysis, worst_run(fmu, meets, analysis), fitted, hands)


def worst_run(fmu: UnpackedFmu, meets: RenderedModel, analysis: Analysis) -> LoopRun:
    """Simulate pushes of several depths, each into a new instance; errors as of `UnpackedFmu.worst_run`."""
    expected = _expected(meets, analysis.device, analysis.gains)
    return fmu.worst_run(partial(_runs, fmu, meets, analysis.device, *expected))


def _runs(
    fmu: UnpackedFmu, meets: RenderedModel, device: DeviceSettings, ticks: PeriodicModel, ripple: float
) -> list[LoopRun]:
    runs = []
    for push_mm in PUSHES_MM:
        with fmu.stepping() as step:
            runs.append(_pushed(meets, device, ticks, ripple, step, push_mm))
    return runs


def judge_fmu(
    path: Path, settings: RuntimeSettings, trust: bool = False, effect_files: Iterable[str | os.PathLike] = ()
) -> tuple[Judgement, tuple[str, ...]]:
    """Judge an FMU for FMI 3.0 at its own rate; the judgement, and what to know of it.

    A library for this machine that is trusted is judged by what it answers. Of any other file the record is judged, which is
    what the library does where this machine makes the same one of it, to the byte; else that is said.

    Raises
    ------
    InputError
        If the file is not sound, or cannot be rendered.
    """
    from lumbar.tissue.fmu.check.file_check import NO_LIBRARY, UNKNOWN, all_sound, check_files
    from lumbar.tissue.fmu.check.lint import open_fmu
    from lumbar.tissue.fmu.check.playing import played

    known = catalogues_with(list(effect_files))
    cache = cache_folder(settings.compiler_cache)
    (check,) = all_sound(check_files([path], cache, known, built_anew=False, trust=trust, played=trust))
    files = open_fmu(path)[0]
    if ElementTree.fromstring(files["modelDescription.xml"]).get("fmiVersion") == "2.0":
        raise InputError(f"{path}: FMI 2.0; take the file for FMI 3.0 of the same model, <model>_fmi3.fmu")
    model = None if check.left_out else read_record(parsed_json(files[RECORD], RECORD), known)[0]
    if not check.played:
        why = UNKNOWN if check.unknown else NO_LIBRARY
        if model is None:
            raise InputError(f"{path}: {check.left_out}; {why}")
        judged = judge_exported(model, settings, model.identified, path if check.same_bytes else None)
        return judged, () if check.same_bytes else (f"{path.name} was judged by its record: {why}",)
    device = settings.device
    if model is not None and model.axes:
        return judge_exported(model, settings, model.identified, path), ()
    with unpacked(path) as fmu:
        if fmu.fmu.axes:
            raise InputError(f"{path}: of several axes, and {check.left_out}; export the model again")
        found = played(partial(UnpackedFmu.answers, fmu, device), fmu.folder, kinds=(SampledModel,))
        meets = fmu.rendered(device, *found)
        fit = (model.moving_average, model.identified) if model else (1, None)
        hands = stable_share(meets, *fit, device)
        analysis = analyse(meets, device)
        return Judgement(meets, analysis, worst_run(fmu, meets, analysis), hands=hands), ()


def oscillating_and_calm(judgements: Sequence[Judgement]) -> tuple[Judgement, Judgement] | None:
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
