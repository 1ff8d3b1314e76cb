"""An exported model as the device meets it: linear ones exactly, with effects through their linearisations."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import fmpy
import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.compiler import cache_folder
from lumbar.tissue.fmu.build.export_model import AS_IN_THESIS, ExportModel, averaged_samples, export_models
from lumbar.tissue.fmu.build.guards import shortened
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.conventions import work_units
from lumbar.tissue.fmu.instance import Instance, UnzippedFmu
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.simulation import PUSH_MM, Step, on_servo
from lumbar.tissue.haptics.ticks import PeriodicModel
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
        return export_models([model], settings.model_copy(update={"unstable": "export"}))[0]
    own = 1.0 / settings.rate_Hz if settings.rate_Hz else model.sampling_time
    # The same milliseconds would be less than a sample at a low rate.
    samples = averaged_samples(model.name, settings.moving_average_ms, own)
    plain = settings.model_copy(update={"rate_Hz": rate, "moving_average_ms": 0.0, "unstable": "export"})
    return replace(export_models([model], plain)[0], moving_average=samples)


@dataclass(frozen=True)
class RenderedModel:
    """A model in the units of a device."""

    name: str
    sampled: tuple[SampledModel, ...]
    """The model, or its linearisations, at the FMU's own samples, in N/m."""
    loops: tuple[SampledModel | PeriodicModel, ...]
    """The same as the servo of the device meets them."""
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
    model : ExportModel
        Its `resistance`, 1 or -1, is the sign of the force that resists where it is displayed.
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
    metre, newton = scale_of(model.name, model.input, model.output)
    signed = model.resistance * newton
    sampled = tuple(item.scaled(signed / metre) for item in found)
    loops = tuple(loop for item in sampled for loop in on_servo(item, device, held=late))
    return RenderedModel(
        model.name,
        sampled,
        loops,
        metre,
        signed,
        model.input,
        model.output,
        newton * model.output_limit,
        reach,
        beside(model.guards.rate_limit > 0, still),
    )


Responses = list[tuple[str, np.ndarray]]
"""Impulse responses of a model that is not linear, with their names; each of shape (samples, axes, axes)."""


def linearised(
    model: ExportModel, device: DeviceSettings, unit: float
) -> tuple[Responses, tuple[float, float] | None, np.ndarray]:
    """Return the `impulse_responses` of a model, one unit of whose input is so many mm, and what `RenderedModel` has beside them.

    That is where they were looked for, None where all are the same, and the forces at rest.
    """
    axes = len(model.axes)
    # Ends of the motion about rest over which it is linearised, in mm: those of what it was fitted to, where they are known.
    low, high = -REACH_MM, REACH_MM
    if model.valid_for:
        ends = model.valid_for.lowest, model.valid_for.highest
        low, high = (unit * (end - model.input.offset) for end in ends)
    reach = min(low, 0.0), max(high, 0.0)

    def limited(positions: np.ndarray) -> np.ndarray:
        places = positions if axes else positions[:, 0]
        forces = shortened(model.output.offset + model.dynamics.response(places / unit), model.output_limit)
        return forces.reshape(positions.shape)

    found = impulse_responses(limited, model.name, model.sampling_time, device, reach, axes or 1)
    still = limited(np.zeros((watched(model.sampling_time), axes or 1)))
    return found, reach if len(found) > 1 else None, still


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
def fmu_of(model: ExportModel, settings: RuntimeSettings) -> Iterator[UnzippedFmu]:
    """Export a model as an FMU for FMI 3.0 for this machine, and unpack it for a while."""
    with tempfile.TemporaryDirectory(prefix="lumbar-render-") as name:
        folder = Path(name)
        cache = cache_folder(settings.compiler_cache)
        (file,) = export_fmus([model], folder, "", ["host"], cache, versions=["3.0"])
        fmpy.extract(str(file), str(folder / "unpacked"))
        fmu = UnzippedFmu(folder / "unpacked")
        try:
            yield fmu
        finally:
            fmu.slave.freeLibrary()


@contextmanager
def stepping(fmu: UnzippedFmu) -> Iterator[Step]:
    """Instantiate an FMU: a function from a position, in its unit, to the force of the same sample; in space of arrays."""
    instance = Instance(fmu, event_mode=True)

    def in_space(position: np.ndarray) -> np.ndarray:
        return np.array(instance.sample(position.tolist()))

    try:
        yield in_space if fmu.axes else instance.sample
    finally:
        instance.free()
