"""Exported models in the units and timing of the device: linear models exactly, models with effects by linearisations."""

import tempfile
from collections.abc import Iterator
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
from lumbar.tissue.fmu.build.linear_model import LinearModel
from lumbar.tissue.fmu.build.package import export_fmus
from lumbar.tissue.fmu.build.reference_response import limit_size
from lumbar.tissue.fmu.conventions import work_units
from lumbar.tissue.fmu.instance import Instance, UnzippedFmu
from lumbar.tissue.haptics.closed_loop import SampledModel
from lumbar.tissue.haptics.in_space import SpatialLoop
from lumbar.tissue.haptics.simulation import PUSH_MM, Step
from lumbar.tissue.haptics.ticks import PeriodicModel, servo_loops
from lumbar.tissue.models.fitted_model import FittedModel

_RESPONSE_S, _MAX_SAMPLES = 4.0, 4000
"""Duration in seconds, and largest number of samples, of the simulated force after a small step."""
STEPS_MM, DEPTH_MM = (1e-6, 1e-3, 1.0), 2.0
"""Steps by which a model with effects is linearised about rest and about a depth. A step of a nanometre gives the slope even
if friction changes its sign within a fraction of a millimetre per second; larger steps, the encoder's among them, give the
response to larger motion. At the steepest and the least steep depth the step is a micrometre."""
REACH_MM = PUSH_MM
"""Distance in mm to both sides of rest within which a model with effects is linearised if its fitted motion is unknown."""
_NEGLIGIBLE_SHARE = 1e-12
"""Share of an impulse response's size below which its end is omitted."""


def export_at(model: FittedModel, settings: RuntimeSettings, rate: float) -> ExportModel:
    """Return a model ready for export at a rate in Hz. The moving average has the same number of samples at every rate.

    A model that runs as in the thesis keeps its rate and average.

    Raises
    ------
    InputError
        If the model cannot be exported.
    NumericalError
        If the model has no counterpart at this rate.
    """
    if model.name.endswith(AS_IN_THESIS):
        return export_models([model], settings.model_copy(update={"unstable": "export"}))[0]
    sampling_time = 1.0 / settings.rate_Hz if settings.rate_Hz else model.sampling_time
    # The same milliseconds would be less than a sample at a low rate.
    samples = averaged_samples(model.name, settings.moving_average_ms, sampling_time)
    plain = settings.model_copy(update={"rate_Hz": rate, "moving_average_ms": 0.0, "unstable": "export"})
    return replace(export_models([model], plain)[0], moving_average=samples)


@dataclass(frozen=True)
class RenderedModel:
    """A model in the units of a device."""

    exported: ExportModel
    sampled: tuple[SampledModel, ...]
    """The model, or its linearisations, at the FMU's samples, in N/m; empty in space."""
    loops: tuple[SampledModel | PeriodicModel | SpatialLoop, ...]
    """The model, or its linearisations, at the ticks of the device's servo."""
    reach: tuple[float, float] | None = None
    """Positions in mm about rest between which the model was linearised; None for a linear model."""
    omitted: str = ""
    """Properties that the linearisations do not contain although they may release energy: a rate limit, which delays large
    forces, or a force that changes only with time."""

    @property
    def name(self) -> str:
        """Name of the exported model."""
        return self.exported.name

    @property
    def limit(self) -> float:
        """Largest force in N."""
        return scale_of(self.exported)[1] * self.exported.output_limit

    @property
    def needs_its_fmu(self) -> bool:
        """True if the model must be simulated by its FMU, because it has effects or guards of the force."""
        guards = self.exported.guards
        return not isinstance(self.exported.dynamics, LinearModel) or guards.active or guards.contact

    @property
    def large_motion_loops(self) -> list[SampledModel | PeriodicModel]:
        """The loops of the largest steps, with forces as large as in a push."""
        large = [item for item in self.loops if item.name.endswith(_step_label(STEPS_MM[-1]))]
        return large or list(self.loops)

    def loop_step(self, force_of: Step) -> Step:
        """Convert an FMU's step from the model's units to a step of the loop: from m to N against the motion."""
        metre, newton = scale_of(self.exported)
        source, force, factor = self.exported.input, self.exported.output, self.exported.resistance * newton
        return lambda position: factor * (force_of(source.offset + position / metre) - force.offset)


def render_model(exported: ExportModel, device: DeviceSettings, *, late: bool = False) -> RenderedModel:
    """Return a model in the units of the device, including hold, average and delays of the rendering.

    `late` is for a client that reads the force before it sets the position of the same sample, as in FMI 2.0: the
    feed-through is one sample late, with effects the whole force.

    Raises
    ------
    InputError
        If the input is not a length or the output not a force; along several axes if the servo's ticks are not whole
        samples.
    NumericalError
        If the force of a model with effects overflows.
    """
    metre, newton = scale_of(exported)
    omitted = ["a limit on its rate"] * (exported.guards.rate_limit > 0)
    responses, reach = [], None
    if isinstance(exported.dynamics, LinearModel):
        model = exported.dynamics.transfer_function
        numerator, denominator = np.array(model.numerator), np.array(model.denominator)
        if late:  # the feed-through a sample later: H(z) − D + D/z
            length = max(len(numerator), len(denominator)) + 1
            padded, through = (
                np.pad(denominator, (0, length - len(denominator))),
                numerator[0] / denominator[0],
            )
            numerator = np.pad(numerator, (0, length - len(numerator)))
            numerator = numerator - through * padded + through * np.roll(padded, 1)
        responses = [(exported.name, numerator, denominator)]
    else:
        linearised = _linearise(exported, device)
        reach = linearised.reach
        omitted += ["a force that changes with time alone"] * linearised.changes_at_rest
        if exported.axes:
            loops = [_spatial_loop(*item, exported, device, late) for item in linearised.impulses]
            return RenderedModel(exported, (), tuple(loops), reach, " and ".join(omitted))
        for name, impulse in linearised.impulses:
            # The impulse response up to the time when it has died away; late, it begins a sample later.
            response = impulse[:, 0, 0]
            last = np.flatnonzero(np.abs(response) > _NEGLIGIBLE_SHARE * np.abs(response).max())
            response = 1e3 * metre * response[: last[-1] + 1 if len(last) else 1]
            responses.append((name, np.concatenate([np.zeros(int(late)), response]), np.ones(1)))
    average = np.full(exported.moving_average, 1.0 / exported.moving_average)
    size = exported.resistance * newton / metre
    sampled = tuple(
        SampledModel(name, size * np.convolve(numerator, average), denominator, exported.sampling_time)
        for name, numerator, denominator in responses
    )
    loops = tuple(loop for item in sampled for loop in servo_loops(item, device, held=late))
    return RenderedModel(exported, sampled, loops, reach, " and ".join(omitted))


@dataclass(frozen=True)
class Linearisation:
    """The linearisations of a nonlinear model."""

    impulses: list[tuple[str, np.ndarray]]
    """Names and impulse responses, in the model's unit of force per mm, each of shape (samples, axes, axes); only one if all
    are equal, as for a linear model."""
    reach: tuple[float, float] | None
    """Positions in mm about rest between which the model was linearised; see `RenderedModel`."""
    changes_at_rest: bool
    """True if the force changes with time at a constant position."""


def _linearise(exported: ExportModel, device: DeviceSettings) -> Linearisation:
    """Linearise a model for small and large motion about rest and about depths along every axis.

    An impulse response is half the difference between the forces after a forward and a backward step, divided by the step.
    """
    axes, offset = len(exported.axes) or 1, exported.output.offset
    unit = 1e3 * scale_of(exported)[0]
    samples = min(_MAX_SAMPLES, round(_RESPONSE_S / exported.sampling_time))

    def response(positions: np.ndarray) -> np.ndarray:
        """Return forces from positions in mm, both of shape (samples, axes)."""
        inputs = positions if exported.axes else positions[:, 0]
        forces = limit_size(offset + exported.dynamics.response(inputs / unit), exported.output_limit)
        return forces.reshape(positions.shape)

    # Ends of the motion in mm about rest: those of the data that it was fitted to, if they are known.
    ends = (-REACH_MM, REACH_MM)
    if known := exported.valid_for:
        ends = tuple(unit * (end - exported.input.offset) for end in (known.lowest, known.highest))
    reach = min(ends[0], 0.0), max(ends[1], 0.0)
    # Axis and depth, and the step there.
    along, steps = np.eye(axes), sorted({*STEPS_MM, 1e-3 * device.encoder_um} - {0.0})
    depths = [(0, 0.0), *((axis, DEPTH_MM) for axis in range(axes))]
    places = [(*depth, step) for depth in depths for step in steps]
    for axis, end in product(range(axes), filter(None, reach)):
        # The depths at which the force rises most and least on a slow path from rest to an end.
        path = np.linspace(0.0, end, samples)
        slopes = np.diff(response(np.multiply.outer(path, along[axis])) @ along[axis]) / np.diff(path)
        places += [(axis, float(path[index]), STEPS_MM[1]) for index in (slopes.argmax(), slopes.argmin())]
    impulses = []
    for axis, depth, step in dict.fromkeys(places):
        about, impulse = depth * along[axis], np.empty((samples, axes, axes))
        for column, direction in enumerate(along):
            # The position is constant before the step, for as long as after it.
            moved = np.multiply.outer(np.repeat([0.0, step], samples), direction)
            forward, back = (response(about + sign * moved)[samples:] for sign in (1.0, -1.0))
            impulse[:, :, column] = np.diff((forward - back) / (2.0 * step), axis=0, prepend=0.0)
        place = ", ".join(f"{part:.4g}" for part in about)
        place = f"({place})" if axes > 1 else place
        impulses.append((f"{exported.name} about {place} mm, {_step_label(step)}", impulse))
    size = np.abs(impulses[0][1]).max()
    same = all(np.abs(item - impulses[0][1]).max() <= 1e-9 * size for _, item in impulses)
    still = response(np.zeros((samples, axes)))
    changes = bool(np.ptp(still) > _NEGLIGIBLE_SHARE * max(np.abs(still).max(), 1.0))
    return Linearisation(impulses[:1] if same else impulses, None if same else reach, changes)


def _step_label(step_mm: float) -> str:
    return f"steps of {step_mm:g} mm"


def _spatial_loop(
    name: str, impulse: np.ndarray, exported: ExportModel, device: DeviceSettings, late: bool
) -> SpatialLoop:
    """Return the linearised loop of several axes at the servo rate; each matrix element is sampled as a model of one axis."""
    average = np.full(exported.moving_average, 1.0 / exported.moving_average)
    size = 1e3 * exported.resistance * scale_of(exported)[1]
    numerators = []
    for element in impulse.reshape(len(impulse), -1).T:
        model = SampledModel(name, size * np.convolve(element, average), np.ones(1), exported.sampling_time)
        loop, *others = servo_loops(model.late(late * exported.sampling_time), device, held=late)
        if others or not isinstance(loop, SampledModel):
            raise InputError(
                f"{name}: along several axes the servo's rate must be the model's or a whole multiple or part of it; "
                f"rate_Hz is {device.rate_Hz:g}"
            )
        numerators.append(loop.numerator)
    unit = SampledModel(name, np.ones(1), np.ones(1), loop.sampling_time, loop.delay)
    return SpatialLoop(name, np.array(numerators).T.reshape(-1, *impulse.shape[1:]), unit)


def scale_of(model: FittedModel | ExportModel) -> tuple[float, float]:
    """Return the size of a model's input unit in m and of its output unit in N.

    Raises
    ------
    InputError
        If input and output are not a length and a force, which a device that moves along a line requires.
    """
    units = work_units(model.input.unit, model.output.unit)
    if not units.is_of_length:
        raise InputError(
            f"{model.name}: its input is {model.input.quantity} in {model.input.unit!r}, its output {model.output.quantity} in "
            f"{model.output.unit!r}; the device of runtime.device moves along a line and needs a length and a force"
        )
    return units.position, units.force


def is_renderable(model: FittedModel | ExportModel) -> bool:
    """Return whether a model's input is a length and its output a force."""
    return work_units(model.input.unit, model.output.unit).is_of_length


@contextmanager
def fmu_of(model: ExportModel, settings: RuntimeSettings) -> Iterator[UnzippedFmu]:
    """Export a model as an FMI 3.0 FMU for this machine, and unpack it for the duration of the context."""
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
    """Instantiate an FMU as a function from a position to the force of the same sample, in its units; in space of arrays."""
    instance = Instance(fmu, event_mode=True)
    try:
        if fmu.axes:
            yield lambda position: np.array(instance.sample(position.tolist()))
        else:
            yield instance.sample
    finally:
        instance.free()
