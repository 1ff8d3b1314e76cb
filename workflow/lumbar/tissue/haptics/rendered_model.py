"""A model as the device meets it, exported or an FMU: linear ones exactly, with effects through their linearisations."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.compiler import cache_folder
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel, averaged_samples, export_models
from lumbar.tissue.fmu.build.guards import shortened
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.check.instance import Instance, UnzippedFmu
from lumbar.tissue.fmu.check.playing import PlayError, played
from lumbar.tissue.fmu.conventions import RATE_LIMIT, slow_push, told_meaning, work_units
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.simulation import PUSH_MM, LoopRun, Step, on_servo
from lumbar.tissue.haptics.ticks.sequence import PeriodicModel
from lumbar.tissue.haptics.ticks.uneven import WorstTiming, worst_timing
from lumbar.tissue.models.fitted_model import FittedModel
from lumbar.tissue.models.model_data import Port

_WATCHED_S, _MOST_SAMPLES = 4.0, 4000
"""How long the force after a small step is followed."""
STEPS_MM, DEPTH_MM = (1e-6, 1e-3, 1.0), 2.0
"""A model with effects is linearised about rest and about this depth: by its slope, which a step of a nanometre gives where
friction turns its sign within a fraction of a millimetre a second, and by steps of other sizes, the encoder's among them; by a
micrometre's where it is steepest and least steep, too."""
REACH_MM = PUSH_MM
"""How far to both sides of rest a model with effects is looked at where the motion that it was fitted to is not known."""
_ENDED = 1e-12
"""Share of an impulse response's size below which its end is left out."""


def export_at(model: FittedModel, settings: RuntimeSettings, rate: float) -> ExportModel:
    """Return a model as it would be exported at a rate in Hz, its moving average over as many samples at every rate.

    A model as the thesis ran it has its own rate and average.

    Raises
    ------
    InputError
        If it cannot be exported.
    NumericalError
        If it has no counterpart at this rate.
    """
    if model.name.endswith(AS_IN_THESIS):
        return export_models([model], replace(settings, unstable="export"))[0]
    own = 1.0 / settings.rate_Hz if settings.rate_Hz else model.sampling_time
    # The same milliseconds would be less than a sample at a low rate.
    samples = averaged_samples(model.name, settings.moving_average_ms, own)
    plain = replace(settings, rate_Hz=rate, moving_average_ms=0.0, unstable="export")
    return replace(export_models([model], plain)[0], moving_average=samples)


@dataclass(frozen=True)
class RenderedModel:
    """A model in the units of a device."""

    name: str
    sampled: tuple[SampledModel, ...]
    """The model, or its linearisations, at the FMU's own samples, in N/m."""
    loops: tuple[SampledModel | PeriodicModel, ...]
    """The same as the servo of the device meets them, with ticks that are uneven in their worst timings too."""
    timings: tuple[WorstTiming, ...]
    """Those timings; empty where ticks are even."""
    metre: float
    newton: float
    """`metre`, `newton`: one unit of the model's input in m, one of its output in N, positive where it resists as it is
    displayed."""
    input: Port
    output: Port
    limit: float
    """Largest force in N."""
    reach: tuple[float, float] | None = None
    """Positions in mm about rest between which it was linearised; None of a model that is linear, effects or not."""
    beside: str = ""
    """What its linearisations do not hold and may give out energy, in words: a limit on the force's rate, which makes large ones
    late, or a force that changes with time alone."""

    @property
    def of_large_motion(self) -> list[SampledModel | PeriodicModel]:
        """Those of the loops that are linearised by the largest steps: forces are of the size that a push gives."""
        large = [item for item in self.loops if item.name.endswith(_by_steps(STEPS_MM[-1]))]
        return large or list(self.loops)

    @property
    def linearised(self) -> bool:
        """Whether the model has effects."""
        return len(self.sampled) > 1

    def in_loop(self, force_of: Step) -> Step:
        """Return an FMU's step, in the model's units, as a loop takes it: from m to N against the motion."""

        def step(position: float) -> float:
            given = self.input.offset + position / self.metre
            return self.newton * (force_of(given) - self.output.offset)

        return step


def render_model(model: ExportModel, device: DeviceSettings, *, late: bool = False) -> RenderedModel:
    """Return a model in the units of the device, with the hold, the average and the delays that it is rendered with.

    Parameters
    ----------
    late : bool
        Whether the client reads the force before it has set the position of the same sample, as FMI 2.0 has it: the
        feed-through is one sample late, with effects the whole force.

    Raises
    ------
    InputError
        If the input is no length or the output no force.
    NumericalError
        If the force of a model with effects overflows.
    """
    reach, still = None, np.zeros(1)
    if isinstance(model.dynamics, LinearModel):
        whole = SampledModel.of(model.name, model.dynamics.transfer_function, model.sampling_time)
        found = [_fed_late(whole) if late else whole]
    else:
        unit = 1e3 * scale_of(model.name, model.input, model.output)[0]
        responses, reach, still = linearised(model, device, unit)
        found = [_sampled(*item, model.sampling_time) for item in responses]
        found = [item.scaled(unit).late(model.sampling_time if late else 0.0) for item in found]
    average = np.full(model.moving_average, 1.0 / model.moving_average)
    found = [replace(item, numerator=np.convolve(item.numerator, average)) for item in found]
    rendered = in_units(
        found, model.name, model.input, model.output, model.output_limit, device, model.resistance, held=late
    )
    return replace(rendered, reach=reach, beside=beside(model.guards.rate_limit > 0, still))


Responses = list[tuple[str, np.ndarray]]
"""Impulse responses of a model that is not linear, with their names; each of shape (samples, axes, axes)."""


def linearised(
    model: ExportModel, device: DeviceSettings, unit: float
) -> tuple[Responses, tuple[float, float] | None, np.ndarray]:
    """Return the `impulse_responses` of a model, one unit of whose input is so many mm, and what `RenderedModel` has beside them.

    That is where they were looked for, None where all are the same, and the forces at rest.
    """
    axes = len(model.axes)
    known = model.valid_for and (model.valid_for.lowest, model.valid_for.highest)
    reach = reach_mm(known, model.input.offset, unit)

    def limited(positions: np.ndarray) -> np.ndarray:
        places = positions if axes else positions[:, 0]
        forces = shortened(model.output.offset + model.dynamics.response(places / unit), model.output_limit)
        return forces.reshape(positions.shape)

    found = impulse_responses(limited, model.name, model.sampling_time, device, reach, axes or 1)
    still = limited(np.zeros((watched(model.sampling_time), axes or 1)))
    return found, reach if len(found) > 1 else None, still


def in_units(
    found: list[SampledModel],
    name: str,
    input: Port,
    output: Port,
    limit: float,
    device: DeviceSettings,
    resistance: float,
    *,
    held: bool = False,
) -> RenderedModel:
    """Return a model or its linearisations, given in its own units as `limit` is, in those of the device.

    `resistance`, 1 or -1, is the sign of the force that resists where it is displayed, as of `ExportModel.resistance`; `held` as
    of `on_servo`; errors as of `render_model`.
    """
    metre, newton = scale_of(name, input, output)
    signed = resistance * newton
    sampled = tuple(item.scaled(signed / metre) for item in found)
    loops = tuple(loop for item in sampled for loop in on_servo(item, device, held=held))
    uneven = device.jitter_percent or device.missed_ticks
    timings = tuple(worst_timing(item, device, held=held) for item in sampled) if uneven else ()
    loops += tuple(item.loop for item in timings)
    return RenderedModel(name, sampled, loops, timings, metre, signed, input, output, newton * limit)


def scale_of(name: str, input: Port, output: Port) -> tuple[float, float]:
    """One unit of a model's input in m and one of its output in N; errors as of `render_model`."""
    units = work_units(input.unit, output.unit)
    if units is None or units[2] != "N·s/m":
        raise InputError(
            f"{name}: it takes {input.quantity} in {input.unit!r} and gives {output.quantity} in {output.unit!r}; the "
            "device of runtime.device moves along a line and needs a length and a force"
        )
    return units[:2]


def watched(sampling_time: float) -> int:
    """Samples over which a model is followed."""
    return min(_MOST_SAMPLES, round(_WATCHED_S / sampling_time))


def beside(rate_limited: bool, still: np.ndarray) -> str:
    """Words for `RenderedModel`, of the forces at a position that stays."""
    alone = np.ptp(still) > _ENDED * max(np.abs(still).max(), 1.0)
    found = ["a limit on its rate"] * rate_limited + ["a force that changes with time alone"] * bool(alone)
    return " and ".join(found)


def reach_mm(known: tuple[float, float] | None, rest: float, unit: float) -> tuple[float, float]:
    """Ends of the motion about rest over which a model with effects is linearised, in mm.

    Parameters
    ----------
    known : tuple of float, optional
        Lowest and highest position of what it was fitted to, where that is known.
    rest : float
        Position at which it rests.
    unit : float
        Of both, in mm.
    """
    low, high = (-REACH_MM, REACH_MM) if known is None else (unit * (end - rest) for end in known)
    return min(low, 0.0), max(high, 0.0)


def renderable(model: FittedModel | ExportModel) -> bool:
    """Whether a model takes a length and gives a force, which is what a device that moves along a line needs."""
    units = work_units(model.input.unit, model.output.unit)
    return units is not None and units[2] == "N·s/m"


def _fed_late(model: SampledModel) -> SampledModel:
    """The model with its feed-through one sample late, H(z) − D + D/z."""
    parts = model.numerator, model.denominator
    length = max(map(len, parts)) + 1
    numerator, denominator = (np.pad(part, (0, length - len(part))) for part in parts)
    through = numerator[0] / denominator[0]
    return replace(model, numerator=numerator - through * denominator + through * np.roll(denominator, 1))


def impulse_responses(
    response: Callable[[np.ndarray], np.ndarray],
    name: str,
    sampling_time: float,
    device: DeviceSettings,
    reach: tuple[float, float],
    axes: int,
) -> Responses:
    """Impulse responses of a model that is not linear, for small and large motion about rest and about depths along every axis.

    Half the difference of the forces after a step forth and a step back, over the step, in the model's unit of force
    per mm; one where all are the same, as those of a linear model are.

    Parameters
    ----------
    response : callable
        From positions in mm, the first held before, to forces, both of shape (samples, axes).
    sampling_time : float
        Seconds.
    reach : tuple of float
        As of `reach_mm`.
    """
    samples, along = watched(sampling_time), np.eye(axes)
    steps = sorted({*STEPS_MM, 1e-3 * device.encoder_um} - {0.0})
    depths = [(0, 0.0), *((axis, DEPTH_MM) for axis in range(axes))]
    places = [(*depth, step) for depth in depths for step in steps]
    for axis, end in product(range(axes), filter(None, reach)):
        places += [(axis, depth, STEPS_MM[1]) for depth in _steepest(response, end, along[axis], samples)]
    found: Responses = []
    for axis, depth, step in dict.fromkeys(places):
        about, impulse = depth * along[axis], np.empty((samples, axes, axes))
        for column, way in enumerate(along):
            moved = np.multiply.outer(np.repeat([0.0, step], samples), way)
            forth, back = (response(about + sign * moved)[samples:] for sign in (1.0, -1.0))
            impulse[:, :, column] = np.diff((forth - back) / (2.0 * step), axis=0, prepend=0.0)
        where = ", ".join(f"{part:.4g}" for part in about)
        found.append((f"{name} about {f'({where})' if axes > 1 else where} mm, {_by_steps(step)}", impulse))
    size = np.abs(found[0][1]).max()
    same = all(np.abs(item - found[0][1]).max() <= 1e-9 * size for _, item in found)
    return found[:1] if same else found


def _steepest(
    response: Callable[[np.ndarray], np.ndarray], end: float, axis: np.ndarray, samples: int
) -> tuple[float, float]:
    """Depths at which the force rises most and least on a slow way from rest along an axis to an end, in mm."""
    way = np.linspace(0.0, end, samples)
    slopes = np.diff(response(np.multiply.outer(way, axis)) @ axis) / np.diff(way)
    return float(way[slopes.argmax()]), float(way[slopes.argmin()])


def _by_steps(step_mm: float) -> str:
    return f"steps of {step_mm:g} mm"


def _sampled(name: str, impulse: np.ndarray, sampling_time: float) -> SampledModel:
    """A model of one axis of an impulse response up to where it has died away."""
    numerator = impulse[:, 0, 0]
    last = np.flatnonzero(np.abs(numerator) > _ENDED * np.abs(numerator).max())
    kept = numerator[: last[-1] + 1 if len(last) else 1]
    return SampledModel(name, kept, np.ones(1), sampling_time)


@contextmanager
def unpacked(path: Path) -> "Iterator[UnpackedFmu]":
    """Unpack an FMU for FMI 3.0 of an export for a while; a library that does not play is an InputError with its path."""
    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as folder:
        fmpy.extract(str(path), folder)
        try:
            yield UnpackedFmu(Path(folder))
        except PlayError as error:
            raise InputError(f"{path}: {error}") from error


@contextmanager
def fmu_of(model: ExportModel, settings: RuntimeSettings, file: Path | None) -> "Iterator[UnpackedFmu]":
    """Unpack the FMU of a model for a while: its file, or one that is made for this machine where there is none."""
    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as folder:
        cache = cache_folder(settings.compiler_cache)
        made = file or export_fmus([model], Path(folder), "", ["host"], cache, versions=["3.0"])[0]
        with unpacked(made) as fmu:
            yield fmu


class UnpackedFmu:
    """An FMU for FMI 3.0 in a folder, which is loaded once, by the process that plays it, and instantiated as often as it is."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._held: dict[tuple[float, int], tuple[Instance, list[float], Any]] = {}

    @cached_property
    def fmu(self) -> UnzippedFmu:
        """What it says, and its library."""
        return UnzippedFmu(self.folder)

    @contextmanager
    def stepping(self) -> Iterator[Step]:
        """Instantiate it: a function from a position, in its unit, to the force of the same sample; in space of arrays."""
        instance = Instance(self.fmu, event_mode=True)

        def in_space(position: np.ndarray) -> np.ndarray:
            return np.array(instance.sample(position.tolist()))

        try:
            yield in_space if self.fmu.axes else instance.sample
        finally:
            instance.free()

    def worst_run(self, play: Callable[[], list[LoopRun]]) -> LoopRun:
        """The run that is least at rest of those that `play` makes with it, in a process of its own; errors as of `played`."""
        runs = played(play, self.folder, kinds=(LoopRun,))
        return max(runs, key=lambda run: (not run.calm, run.peak_to_peak))

    def response(self, positions: np.ndarray) -> np.ndarray:
        """Forces of an instance from its start on to positions in its unit; shape (samples,).

        A first position that is held is played once for all motions that begin with it so long, where a state can be kept.
        """
        held = int(np.flatnonzero(np.append(positions != positions[0], True))[0])
        if not self.fmu.description.coSimulation.canGetAndSetFMUstate:
            return np.array(Instance(self.fmu, event_mode=True).play(positions.tolist()))
        begins = positions[:held].tolist()
        if (begins[0], held) not in self._held:
            instance = Instance(self.fmu, event_mode=True)
            self._held[begins[0], held] = instance, instance.play(begins), instance.save()
        instance, forces, state = self._held[begins[0], held]
        instance.restore(state)
        return np.array([*forces, *instance.play(positions[held:].tolist())])

    def answers(self, device: DeviceSettings) -> tuple[list[SampledModel], np.ndarray, float]:
        """What comes of playing it: linearisations in its units, forces at the start, the sign of `ExportModel.resistance`."""
        start, unit, reach, told = self._said
        name, step = self.fmu.description.modelName, self.fmu.sampling_time

        def response(positions: np.ndarray) -> np.ndarray:
            return self.response(start + positions[:, 0] / unit)[:, None]

        found = impulse_responses(response, name, step, device, reach, 1)
        still = self.response(np.full(watched(step), start))
        return [_sampled(*item, step).scaled(unit) for item in found], still, self._resistance(told, start)

    def rendered(
        self, device: DeviceSettings, found: list[SampledModel], still: np.ndarray, resistance: float
    ) -> RenderedModel:
        """The FMU as the device meets it, of what it answers: through its linearisations where it has effects."""
        fmu, (start, _, reach, _) = self.fmu, self._said
        position, force = (fmu.variables[port] for port in fmu.ports)
        x, y = Port(position.name, position.unit or "1", start), Port(force.name, force.unit or "1", still[0])
        rendered = in_units(found, fmu.description.modelName, x, y, float(force.max), device, resistance)
        limited = any(item.endswith(RATE_LIMIT) for item in fmu.variables)
        return replace(rendered, reach=reach if len(found) > 1 else None, beside=beside(limited, still))

    @property
    def _said(self) -> tuple[float, float, tuple[float, float], dict | None]:
        """First position, one unit of it in mm, where it is linearised, and what its annotation tells."""
        fmu = self.fmu
        position, force = (fmu.variables[port] for port in fmu.ports)
        start = float(position.start)
        ports = (Port(item.name, item.unit or "1") for item in (position, force))
        unit = 1e3 * scale_of(fmu.description.modelName, *ports)[0]
        told = told_meaning(ElementTree.parse(fmu.folder / "modelDescription.xml").getroot())
        known = (float(told["lowest"]), float(told["highest"])) if told and "lowest" in told else None
        return start, unit, reach_mm(known, start, unit), told

    def _resistance(self, told: dict | None, start: float) -> float:
        """The sign of `ExportModel.resistance`: what the file tells, of a file without annotation what a push is answered by."""
        if told is None:
            pushed = self.response(start + slow_push(self.fmu.sampling_time))
            return -1.0 if pushed.mean() < pushed[0] else 1.0
        return 1.0 if told.get("prescribed") else float(told["resisting_sign"])
