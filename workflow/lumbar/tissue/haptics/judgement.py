"""Models on a device in a hand: damping needed, largest stable gain, the loop in time, and from which rate on each is safe."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.instance import UnzippedFmu
from lumbar.tissue.haptics.closed_loop import largest_stable_gain
from lumbar.tissue.haptics.in_space import judge_in_space
from lumbar.tissue.haptics.passivity import lowest_rates, required_damping
from lumbar.tissue.haptics.rendered_model import (
    RenderedModel,
    export_at,
    fmu_of,
    render_model,
    scale_of,
    stepping,
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
    worst_run,
)
from lumbar.tissue.haptics.ticks import PeriodicModel, in_ticks
from lumbar.tissue.haptics.verdict import Analysis, Judgement, WorstHand
from lumbar.tissue.models.fitted_model import FittedModel

MOST_STATES = 400
"""Of a loop whose response to errors of the encoder is followed; longer ones, kept as impulse responses, are not."""
MOST_STATES_IN_HANDS = 100
"""States of a loop that is judged in the corners of the hand's range."""


def analyse(model: RenderedModel, device: DeviceSettings) -> Analysis:
    """Analyse the loop of a model, or of all its linearisations."""
    damping = max(map(required_damping, model.loops))
    gains = [largest_stable_gain(item, device) for item in model.loops]
    gain = min(gains)
    loop = model.loops[gains.index(gain)].name
    rate = 1.0 / model.sampled[0].sampling_time
    found = Analysis(model.name, rate, device, damping, *gain, loop, tuple(each for each, _ in gains))
    return replace(found, reach=model.reach, beside=model.beside)


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
    ticks = in_ticks(model.loops[int(np.argmin(gains))])
    # In a stable loop the encoder's steps may go on wherever it comes to rest: at rest too, where an effect may be stiffest.
    few = [item for item in map(in_ticks, model.loops) if len(item.states[0]) <= MOST_STATES]
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


def judge(models: Sequence[FittedModel], settings: RuntimeSettings) -> tuple[list[Judgement], list[str]]:
    """Judge models as they are exported and at the rate of the servo.

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
                found.append(replace(judged, lowest_passive_rate=passive, lowest_stable_rate=stable))
    return found, list(dict.fromkeys(refused))


def judge_exported(
    exported: ExportModel, settings: RuntimeSettings, fitted: FittedModel | None = None
) -> Judgement:
    """Judge a model as it is exported, a linear one by its difference equation, others with the FMU itself in the loop.

    `fitted` is what it was exported from.
    """
    if exported.axes:
        return judge_in_space(exported, settings, fitted)
    device = settings.device
    meets = render_model(exported, device)
    hand = worst_hand(meets, device)
    analysis = analyse(meets, device)
    guards = exported.guards
    if isinstance(exported.dynamics, LinearModel) and not (guards.active or guards.contact):
        return Judgement(meets, analysis, run_loop(meets, device, gains=analysis.gains), fitted, hand)
    expected = _expected(meets, device, analysis.gains)
    with fmu_of(exported, settings) as fmu:
        run = worst_run(_runs(fmu, meets, device, *expected))
    return Judgement(meets, analysis, run, fitted, hand)


def _runs(
    fmu: UnzippedFmu, meets: RenderedModel, device: DeviceSettings, ticks: PeriodicModel, ripple: float
) -> Iterator[LoopRun]:
    """Simulate pushes of several depths, each into a new instance."""
    for push_mm in PUSHES_MM:
        with stepping(fmu) as step:
            yield _pushed(meets, device, ticks, ripple, step, push_mm)


def worst_hand(model: RenderedModel, device: DeviceSettings) -> WorstHand | None:
    """Return the corner of the hand's range in which the loops are least stable; None if one has too many states."""
    loops = [in_ticks(loop) for loop in model.loops]
    if any(len(loop.states[0]) > MOST_STATES_IN_HANDS for loop in loops):
        return None
    radii = {}
    for stiffness, damping in product(device.hands_stiffness_N_m, device.hands_damping_N_s_m):
        hand = device.model_copy(update={"hand_stiffness_N_m": stiffness, "hand_damping_N_s_m": damping})
        radii[stiffness, damping] = max(
            float(np.abs(np.linalg.eigvals(loop.monodromy(hand))).max()) for loop in loops
        )
    corner = max(radii, key=radii.__getitem__)
    return WorstHand(*corner, stable=radii[corner] < 1.0)


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
