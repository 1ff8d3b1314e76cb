"""The verdict on a model on a device in a hand: passive, stable or unstable, and the limits of the loop.

`judge_loop` combines the analysis of the loop, delays and sampling included, with its simulation and the worst corner of the
hand's range; `loop_sentence` states the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product, repeat

import numpy as np

from lumbar.base.errors import InputError, NumericalError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel
from lumbar.tissue.haptics.closed_loop import StableGain, largest_stable_gain
from lumbar.tissue.haptics.in_space import SpatialLoop, direction_text
from lumbar.tissue.haptics.rendered_model import (
    RenderedModel,
    export_at,
    fmu_of,
    render_model,
    scale_of,
    stepping,
)
from lumbar.tissue.haptics.simulation import (
    PUSHES_MM,
    HandPush,
    LoopRun,
    Step,
    TissueForce,
    difference_equation,
    encoder_ripple,
    one_step,
    simulate,
    worst_run,
)
from lumbar.tissue.haptics.ticks import required_damping, to_periodic
from lumbar.tissue.haptics.z_width import lowest_rates
from lumbar.tissue.models.fitted_model import FittedModel

MAX_STATES = 400
"""Largest number of states of a loop for which the response to encoder errors is computed."""
MAX_STATES_IN_HANDS = 100
"""Largest number of states of a loop that is judged in the corners of the hand's range."""


@dataclass(frozen=True)
class LoopAnalysis:
    """The linear analysis of a model in the loop. For a model with effects the worst linearisation counts."""

    model: RenderedModel
    device: DeviceSettings
    damping: float
    """Smallest damping of the device for a passive loop in N·s/m."""
    limits: tuple[StableGain, ...]
    """Largest stable gain of each loop of the model."""
    damping_direction: np.ndarray | None = None
    """Direction in space that requires `damping`; None along one axis."""

    @property
    def rate(self) -> float:
        """Rate in Hz at which the model samples the position."""
        return 1.0 / self.model.exported.sampling_time

    @property
    def worst(self) -> int:
        """Index of the loop with the smallest stable gain."""
        return min(range(len(self.limits)), key=lambda index: self.limits[index].gain)

    @property
    def limit(self) -> StableGain:
        """Largest stable gain of the worst loop."""
        return self.limits[self.worst]

    @property
    def gain(self) -> float:
        """Largest stable factor on the model's force."""
        return self.limit.gain

    @property
    def stable(self) -> bool:
        """True if analysis shows a stable loop in the hand of the settings."""
        return self.gain > 1.0

    @property
    def passive(self) -> bool:
        """True if analysis shows a passive device with the model, in any passive hand."""
        return self.damping <= self.device.damping_N_s_m and self.stable and not self.model.omitted

    @property
    def is_in_step(self) -> bool:
        """True if the servo's rate is a whole multiple of the model's rate."""
        times = self.device.rate_Hz / self.rate
        return round(times) >= 1 and abs(times - round(times)) < 1e-9 * times


@dataclass(frozen=True)
class WorstHand:
    """The corner of the hand's range of stiffness and damping in which a loop is least stable."""

    stiffness: float
    """Stiffness of the hand in N/m."""
    damping: float
    """Damping of the hand in N·s/m."""
    radius: float
    """Largest magnitude of a pole of the loop over a period."""

    @property
    def stable(self) -> bool:
        """True if the loop is stable in this hand."""
        return self.radius < 1.0

    @property
    def label(self) -> str:
        """Stiffness and damping of the hand with their units, as text."""
        return f"a hand of {self.stiffness:g} N/m and {self.damping:g} N·s/m"


@dataclass(frozen=True)
class LoopVerdict:
    """The verdict on a model at one rate on the settings' device: the worse of analysis and simulation."""

    analysis: LoopAnalysis
    run: LoopRun
    """The simulated loop that is least calm at the end."""
    worst_hand: WorstHand | None = None
    """The worst corner of the hand's range; None in space or with more than `MAX_STATES_IN_HANDS` states."""
    fitted: FittedModel | None = None
    """The model before the export."""
    lowest_passive_rate: float | None = None
    """Lowest rate in Hz with a passive loop at all higher rates; None if there is none or it was not searched."""
    lowest_stable_rate: float | None = None
    """Lowest rate in Hz with a stable loop at all higher rates; None if there is none or it was not searched."""

    @property
    def model(self) -> RenderedModel:
        """The model in the units of the device."""
        return self.analysis.model

    @property
    def passive(self) -> bool:
        """True if the device is passive with the model in any passive hand, and the simulated loop ends at rest."""
        return self.analysis.passive and self.run.calm

    @property
    def stable(self) -> bool:
        """True if the loop is stable in the hand of the settings, by analysis and simulation."""
        return self.analysis.stable and self.run.calm

    @property
    def safe(self) -> bool:
        """True if the loop is stable in the hand of the settings and in the worst corner of the hand's range."""
        return self.stable and (self.worst_hand is None or self.worst_hand.stable)

    @property
    def finding(self) -> str:
        """The verdict in a sentence."""
        return loop_sentence(self.analysis, self.run, self.worst_hand)


def loop_sentence(
    analysis: LoopAnalysis, run: LoopRun | None = None, worst_hand: WorstHand | None = None
) -> str:
    """Return the verdict with the numbers of analysis and simulation; if they differ, name the deciding method."""
    model, device, gain, limit = analysis.model, analysis.device, analysis.gain, analysis.limit
    suffices, omitted = analysis.damping <= device.damping_N_s_m, model.omitted
    within = f" from {model.reach[0]:.3g} to {model.reach[1]:.3g} mm" if model.reach else ""
    if not analysis.stable:
        loop = model.loops[analysis.worst].name.removeprefix(model.name)
        decided = f" by its linearisation{loop}" if model.reach else " by the analysis"
        state = "UNSTABLE" + (decided if run and run.calm else "")
    elif run and not run.calm:
        state = "UNSTABLE by the simulation"
    elif analysis.passive:
        state = f"passive in any hand{within}"
    else:
        state = f"stable in this hand{within}, not passive{f' with {omitted}' if suffices else ''}"
    parts = [f"it needs {analysis.damping:.3g} N·s/m to be passive{omitted and f' without {omitted}'}"]
    if np.isinf(analysis.damping):
        parts = ["no damping makes it passive: its static stiffness is negative"]
    if 0 < gain < np.inf:
        begins = f"it oscillates at {limit.frequency:.3g} Hz" if limit.frequency else "it runs away"
        parts.append(f"largest stable gain {gain:.3g}, where {begins}")
    else:
        parts.append(f"no gain is {'too large' if gain else 'stable'}")
    if analysis.damping_direction is not None:
        axes = model.exported.axes
        directions = f"along {direction_text(axes, analysis.damping_direction)} it needs most damping"
        if gain < np.inf:
            directions += f", along {direction_text(axes, limit.direction)} the least gain is stable"
        parts.append(directions)
    if run:
        parts.append(f"simulated, {run.outcome}")
    if worst_hand:
        parts.append(f"{'stable' if worst_hand.stable else 'UNSTABLE'} in {worst_hand.label}")
    served = "" if analysis.is_in_step else f", served at {device.rate_Hz:.6g} Hz"
    return f"{model.name} at {analysis.rate:.4g} Hz{served}: {state} ({'; '.join(parts)})"


def analyse(model: RenderedModel, device: DeviceSettings) -> LoopAnalysis:
    """Analyse the loop of a model, or of all its linearisations."""
    needs = [
        loop.required_damping() if isinstance(loop, SpatialLoop) else (required_damping(loop), None)
        for loop in model.loops
    ]
    damping, direction = max(needs, key=lambda item: item[0])
    limits = tuple(largest_stable_gain(loop, device) for loop in model.loops)
    return LoopAnalysis(model, device, damping, limits, direction)


def judge_loop(
    exported: ExportModel,
    settings: RuntimeSettings,
    fitted: FittedModel | None = None,
    lowest: tuple[float | None, float | None] = (None, None),
) -> LoopVerdict:
    """Judge a model as it is exported: linear analysis, simulation, and the worst corner of the hand's range.

    A linear model is simulated by its difference equation, other models by their FMU in the loop. Models of several axes are
    judged in the settings' hand only.

    `fitted` is the model before the export; `lowest` are the lowest passive and the lowest stable rate in Hz (None: unknown).

    Raises
    ------
    InputError
        In the cases of `lumbar.tissue.haptics.rendered_model.render_model`.
    """
    analysis = analyse(render_model(exported, settings.device), settings.device)
    ripple = expected_ripple(analysis)
    if analysis.model.needs_its_fmu:
        runs = []
        with fmu_of(exported, settings) as fmu:
            for direction, depth_mm in product(_push_directions(analysis), PUSHES_MM):
                with stepping(fmu) as step:
                    runs.append(run_loop(analysis, step, HandPush(depth_mm, direction), ripple))
        run = worst_run(runs)
    else:
        run = run_loop(analysis, ripple=ripple)
    return LoopVerdict(analysis, run, find_worst_hand(analysis), fitted, *lowest)


def expected_ripple(analysis: LoopAnalysis) -> float:
    """Return the ripple that the loops of a model explain, see `LoopRun`."""
    model, device = analysis.model, analysis.device
    if model.exported.axes:
        is_steady = analysis.stable and device.hand_stiffness_N_m > 0
        return max(
            loop.encoder_ripple(device) if is_steady else loop.one_step(device) for loop in model.loops
        )
    # In a stable loop the steps may go on wherever the stylus stops, even at rest, where an effect may be stiffest.
    few = [loop for loop in map(to_periodic, model.loops) if len(loop.states.a) <= MAX_STATES]
    if analysis.stable and few:
        return max(encoder_ripple(loop, device) for loop in few)
    return max(one_step(loop, device) for loop in model.large_motion_loops)


def run_loop(
    analysis: LoopAnalysis,
    force_of: Step | None = None,
    push: HandPush | None = None,
    ripple: float | None = None,
) -> LoopRun:
    """Simulate a push into an analysed model and the motion after it.

    Parameters
    ----------
    analysis : LoopAnalysis
        Analysed model; the worst loop decides the servo's ticks.
    force_of : callable, optional
        Function from a position to its force in the model's units, sample by sample: the FMU itself. Models with effects
        require it; without it a linear model is simulated by its difference equation.
    push : HandPush, optional
        Push of the hand; by default `PUSH_MM` deep along the first axis.
    ripple : float, optional
        Explained ripple in N; by default the result of `expected_ripple`.
    """
    model, device = analysis.model, analysis.device
    step = difference_equation(model.sampled[0]) if force_of is None else model.loop_step(force_of)
    intervals = repeat(1.0 / device.rate_Hz)
    if not model.exported.axes:
        intervals = to_periodic(model.loops[analysis.worst]).ticks()
    ripple = expected_ripple(analysis) if ripple is None else ripple
    force = TissueForce(step, model.exported.sampling_time)
    return simulate(force, intervals, device, model.limit, push or HandPush(), ripple)


def _push_directions(analysis: LoopAnalysis) -> list:
    """Return directions of pushes: the limiting directions of the loop, and the axes of the stiffness for fast motion."""
    if analysis.damping_direction is None:
        return [1.0]
    fast = [loop.response(np.array([np.pi]))[0].real for loop in analysis.model.loops]
    stiffest = max(fast, key=lambda item: np.abs(item).max())
    principal = np.linalg.eigh(stiffest + stiffest.T)[1].T
    directions = [analysis.damping_direction, analysis.limit.direction, *principal]
    return [
        item
        for index, item in enumerate(directions)
        if all(abs(item @ other) < 0.999 for other in directions[:index])
    ]


def find_worst_hand(analysis: LoopAnalysis) -> WorstHand | None:
    """Return the corner of the hand's range with the least stable loops; None in space or with too many states."""
    device = analysis.device
    if analysis.model.exported.axes:
        return None
    loops = [to_periodic(loop) for loop in analysis.model.loops]
    if any(len(loop.states.a) > MAX_STATES_IN_HANDS for loop in loops):
        return None
    corners = []
    for stiffness, damping in product(device.hands_stiffness_N_m, device.hands_damping_N_s_m):
        hand = device.model_copy(update={"hand_stiffness_N_m": stiffness, "hand_damping_N_s_m": damping})
        corners.append(WorstHand(stiffness, damping, max(loop.transitions(hand).radius() for loop in loops)))
    return max(corners, key=lambda corner: corner.radius)


def judge_models(
    models: Sequence[FittedModel], settings: RuntimeSettings
) -> tuple[list[LoopVerdict], list[str]]:
    """Judge models as they are exported and at the rate of the servo.

    Returns
    -------
    list of LoopVerdict
        Verdicts on each model at the rate of identification, at ``settings.rate_Hz`` and at the servo's rate; a model that runs
        as in the thesis has only the first.
    list of str
        Reasons for missing verdicts: the input is not a length, or the model has no counterpart at a rate.

    Raises
    ------
    InputError
        If a model cannot be exported.
    """
    verdicts, refused = [], []
    for model in models:
        try:
            scale_of(model)
        except InputError as error:
            refused.append(str(error))
            continue
        identified, is_fixed = 1.0 / model.sampling_time, model.name.endswith(AS_IN_THESIS)
        rates = {identified}
        if not is_fixed:
            rates |= {settings.rate_Hz or identified, max(identified, settings.device.rate_Hz)}
        lowest = lowest_rates(model, settings) if model.discrete and not is_fixed else (None, None)
        for rate in sorted(rates):
            try:
                exported = export_at(model, settings, rate)
            except NumericalError as error:
                refused.append(str(error))
            else:
                verdicts.append(judge_loop(exported, settings, model, lowest))
    return verdicts, list(dict.fromkeys(refused))
