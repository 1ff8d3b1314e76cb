"""Models of several axes on a device that is alike in every direction: one loop of matrices, judged in the words of one axis.

Along one axis a device is passive with a held force f = F(exp(jθ)) u over the displacement u of a sample where
F + Fᴴ + 2b/T ≥ 0 for every θ (`lumbar.tissue.haptics.passivity`). In space F is a matrix, and the least eigenvalue of its
Hermitian part asks for the damping b, in the direction of its eigenvector. The loop has a pole at exp(jθ) where an eigenvalue
of H(exp(jθ)) P, with P the response of device and hand, is −1: each of these goes round as the loop of one axis does, and the
first of them to meet the negative real axis ends the stable gains. Where a tissue's matrices share their axes these are its
principal axes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, repeat

import numpy as np

from lumbar.base.errors import InputError
from lumbar.settings.runtime import DeviceSettings, RuntimeSettings
from lumbar.tissue.fmu.build.export_model import ExportModel
from lumbar.tissue.fmu.instance import UnzippedFmu
from lumbar.tissue.haptics.closed_loop import SampledModel, all_angles, loop_response
from lumbar.tissue.haptics.passivity import by_moves
from lumbar.tissue.haptics.rendered_model import (
    RenderedModel,
    beside,
    fmu_of,
    linearised,
    scale_of,
    stepping,
)
from lumbar.tissue.haptics.simulation import PUSHES_MM, LoopRun, TissueForce, course, on_servo, worst_run
from lumbar.tissue.haptics.verdict import Analysis, Judgement
from lumbar.tissue.models.fitted_model import FittedModel

_ROUNDING = 1e-9
_LONG, _LONGEST = 64, 1 << 15
"""Coefficients that are summed at once; samples after which an impulse has died away in a stable loop."""
_FINER = 64
"""Angles that are looked at between two where an eigenvalue may meet the real axis."""


@dataclass(frozen=True)
class SpatialLoop:
    """H(z) of a model or of one of its linearisations as the servo meets it, a matrix in N/m."""

    name: str
    impulse: np.ndarray
    """Shape (samples, axes, axes): force along each axis after a position of 1 m for a sample along each."""
    unit: SampledModel
    """A spring of 1 N/m with the same clock and delay."""

    def response(self, angles: np.ndarray) -> np.ndarray:
        """H(exp(jθ)) without the delay; shape (angles, axes, axes)."""
        axes = self.impulse.shape[1]
        rows = np.pad(self.impulse, ((0, -len(self.impulse) % _LONG), (0, 0), (0, 0))).reshape(
            -1, _LONG, axes**2
        )
        within = np.exp(-1j * np.multiply.outer(angles, np.arange(_LONG)))
        between = np.exp(-1j * np.multiply.outer(angles, _LONG * np.arange(len(rows))))
        columns = np.moveaxis(rows, 1, 0).reshape(_LONG, -1)
        parts = (within.real @ columns + 1j * (within.imag @ columns)).reshape(len(angles), len(rows), -1)
        return np.einsum("ar,are->ae", between, parts).reshape(-1, axes, axes)

    @property
    def static(self) -> np.ndarray:
        """Symmetric part of H(1): what is left of it is no energy of a position that stays."""
        found = self.impulse.sum(axis=0)
        found[np.abs(found) < _ROUNDING * np.abs(self.impulse).sum(axis=0).max()] = 0.0
        return (found + found.T) / 2.0


def required_damping(loop: SpatialLoop) -> tuple[float, np.ndarray]:
    """Smallest damping in N·s/m with which the device is passive in any passive hand, and the direction that asks for it.

    Infinite where a static stiffness is negative.
    """
    stiffness, directions = np.linalg.eigh(loop.static)
    if stiffness[0] < -_ROUNDING * np.abs(stiffness).max(initial=0.0):
        return float("inf"), directions[:, 0]
    angles = all_angles()
    worst = int(_damping_at(loop, angles)[0].argmax())
    near = np.linspace(angles[max(worst - 1, 0)], angles[min(worst + 1, len(angles) - 1)], 101)
    needed, vectors = _damping_at(loop, near)
    at = int(needed.argmax())
    return max(0.0, float(needed[at])), _real(vectors[at])


def _damping_at(loop: SpatialLoop, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Damping that the condition asks for at every angle, and its direction over all axes."""
    moves, seconds = by_moves(loop.unit, angles)
    axes = loop.impulse.shape[1]
    matrix = np.einsum("apq,aij->apiqj", moves, loop.response(angles)).reshape(
        len(angles), -1, len(seconds) * axes
    )
    pieces = np.repeat(seconds, axes)
    values, vectors = np.linalg.eigh(
        np.sqrt(np.outer(pieces, pieces)) * (matrix + matrix.conj().swapaxes(1, 2))
    )
    return -values[:, 0] / 2.0, vectors[:, :axes, 0]


def largest_stable_gain(loop: SpatialLoop, device: DeviceSettings) -> tuple[float, float, np.ndarray]:
    """Largest factor on the forces below which the loop is stable for every factor from 0 on, in Hz what begins there, and where.

    As of one axis (`lumbar.tissue.haptics.closed_loop.largest_stable_gain`), of each eigenvalue of the loop.
    """
    plant = loop_response(loop.unit, device)
    sampling_time = loop.unit.sampling_time

    def eigenvalues(angles: np.ndarray) -> np.ndarray:
        return _in_order(np.linalg.eigvals(loop.response(angles) * plant(angles)[:, None, None]))

    found = list(_static_gains(loop, device))
    angles = all_angles(smallest=1e-6)
    between = _may_cross(angles, eigenvalues(angles))
    finer = np.linspace(*between, _FINER + 1, axis=1)
    for fine, values in zip(
        finer, map(_in_order, eigenvalues(finer.ravel()).reshape(*finer.shape, -1)), strict=True
    ):
        for row, column in zip(*np.nonzero(np.diff(np.signbit(values.imag), axis=0)), strict=True):
            before, after = values[row : row + 2, column]
            share = before.imag / (before.imag - after.imag)
            real = before.real + share * (after.real - before.real)
            if real < 0:
                angle = fine[row] + share * (fine[row + 1] - fine[row])
                found.append((-1.0 / real, angle / (2.0 * np.pi * sampling_time), angle))
    for value in eigenvalues(np.array([np.pi]))[0]:  # real there
        if value.real < 0:
            found.append((-1.0 / value.real, 0.5 / sampling_time, np.pi))
    if not found:
        return float("inf"), 0.0, np.linalg.eigh(loop.static)[1][:, -1]
    gain, frequency, angle = min(found, key=lambda item: item[0])
    if angle == 0:
        return float(gain), 0.0, np.linalg.eigh(loop.static)[1][:, 0]
    (response,) = loop.response(np.array([angle]))
    values, vectors = np.linalg.eig(response * plant(np.array([angle])))
    return float(gain), float(frequency), _real(vectors[:, np.abs(values + 1.0 / gain).argmin()])


def _static_gains(loop: SpatialLoop, device: DeviceSettings) -> Iterator[tuple[float, float, float]]:
    """Factors at which the loop runs away, along each axis of its static stiffness."""
    stiffness, directions = np.linalg.eigh(loop.static)
    size = np.abs(stiffness).max(initial=0.0)
    lags = np.einsum("s,sij->ij", np.arange(len(loop.impulse)), loop.impulse)
    damping = device.damping_N_s_m + device.hand_damping_N_s_m
    for value, direction in zip(stiffness, directions.T, strict=True):
        if device.hand_stiffness_N_m:
            reached = value / device.hand_stiffness_N_m
        elif abs(value) > _ROUNDING * size:
            reached = np.copysign(np.inf, value)
        else:  # a stylus that stays where it is left: as of one axis
            reached = -(direction @ lags @ direction) * loop.unit.sampling_time / damping
        if reached < 0:
            yield -1.0 / reached, 0.0, 0.0


def _in_order(values: np.ndarray) -> np.ndarray:
    """Eigenvalues at one angle after the other, each in the column of the nearest before; shape (angles, axes)."""
    ways = np.array(list(permutations(range(values.shape[1]))))
    found = values.copy()
    for row in range(1, len(found)):
        nearest = np.abs(found[row][ways] - found[row - 1]).sum(axis=1).argmin()
        found[row] = found[row][ways[nearest]]
    return found


def _may_cross(angles: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Begins and ends of the intervals in which an eigenvalue is near the negative real axis, by what it moves meanwhile."""
    moved = np.abs(np.diff(values, axis=0))
    near = np.minimum(np.abs(values[1:].imag), np.abs(values[:-1].imag)) <= 2.0 * moved
    near &= np.minimum(values[1:].real, values[:-1].real) < moved
    rows = np.flatnonzero(near.any(axis=1))
    return angles[rows], angles[rows + 1]


def _real(vector: np.ndarray) -> np.ndarray:
    """A direction from an eigenvector, whose phase means nothing."""
    largest = vector[np.abs(vector).argmax()]
    found = (vector * largest.conj()).real
    return found / np.linalg.norm(found)


def spatial_loops(
    model: ExportModel, device: DeviceSettings, late: bool = False
) -> tuple[list[SpatialLoop], RenderedModel]:
    """Return a model's loops, one of a linear model, else its linearisations about rest and depths along every axis.

    Raises
    ------
    InputError
        If input and output are no length and force, or the servo's ticks are not whole samples: then no more is known of the
        loop along several axes.
    """
    metre, newton = scale_of(model.name, model.input, model.output)
    signed, unit = model.resistance * newton, 1e3 * metre
    responses, reach, still = linearised(model, device, unit)
    average = np.full(model.moving_average, 1.0 / model.moving_average)
    found = []
    for name, impulse in responses:
        items = [
            SampledModel(name, np.convolve(each, average), np.ones(1), model.sampling_time).scaled(
                signed * unit / metre
            )
            for each in impulse.reshape(len(impulse), -1).T
        ]
        served = [_even(item.late(late * model.sampling_time), device, late) for item in items]
        numerators = np.array([item.numerator for item in served]).T
        clock = replace(served[0], name=name, numerator=np.ones(1), denominator=np.ones(1))
        found.append(SpatialLoop(name, numerators.reshape(-1, *impulse.shape[1:]), clock))
    limit = newton * model.output_limit
    nearest = tuple(replace(item.unit, numerator=item.impulse[:, 0, 0]) for item in found)
    words = beside(model.guards.rate_limit > 0, still)
    meets = (nearest, nearest, metre, signed, model.input, model.output, limit, reach, words)
    return found, RenderedModel(model.name, *meets)


def _even(item: SampledModel, device: DeviceSettings, late: bool) -> SampledModel:
    loops = on_servo(item, device, held=late)
    if len(loops) > 1 or not isinstance(loops[0], SampledModel):
        raise InputError(
            f"{item.name}: along several axes a loop is judged with ticks at the model's own rate or a whole multiple or part "
            f"of it; rate_Hz is {device.rate_Hz:g}"
        )
    return loops[0]


def analyse_in_space(
    model: ExportModel, device: DeviceSettings, loops: list[SpatialLoop], meets: RenderedModel
) -> tuple[Analysis, list[np.ndarray]]:
    """Analyse the loop of a model of several axes, or of all its linearisations, and return the directions that ask most."""
    damping, asks = max(map(required_damping, loops), key=lambda item: item[0])
    gains = [largest_stable_gain(item, device) for item in loops]
    worst = min(range(len(loops)), key=lambda index: gains[index][0])
    gain, frequency, along = gains[worst]
    words = f"along {_words(model, asks)} it needs most damping, along {_words(model, along)} the least gain is stable"
    if np.isinf(gain):
        words = f"along {_words(model, asks)} it needs most damping"
    own = (model.name, 1.0 / model.sampling_time, device, damping, gain, frequency, loops[worst].name)
    numbers = tuple(item[0] for item in gains)
    found = Analysis(*own, numbers, reach=meets.reach, beside=meets.beside, directions=words)
    return found, [asks, along]


def _words(model: ExportModel, direction: np.ndarray) -> str:
    signed = direction * (1.0 if direction[np.abs(direction).argmax()] > 0 else -1.0)
    return f"{', '.join(model.axes)} = ({', '.join(f'{value + 0.0:.2g}' for value in np.round(signed, 3))})"


def judge_in_space(
    exported: ExportModel, settings: RuntimeSettings, fitted: FittedModel | None = None
) -> Judgement:
    """Judge a model of several axes as it is exported, with its FMU in the loop, in the settings' hand only.

    Errors are those of `spatial_loops`.
    """
    device = settings.device
    loops, meets = spatial_loops(exported, device)
    analysis, asking = analyse_in_space(exported, device, loops, meets)
    pushed = _pushed(loops, asking)
    steady = analysis.stable and device.hand_stiffness_N_m > 0
    ripple = max((_ripple if steady else _one_step)(loop, device) for loop in loops)
    with fmu_of(exported, settings) as fmu:
        run = worst_run(_runs(fmu, meets, device, pushed, ripple))
    return Judgement(meets, analysis, run, fitted)


def _pushed(loops: Sequence[SpatialLoop], asking: list[np.ndarray]) -> list[np.ndarray]:
    """Directions to push in: those that ask most of the device, and the axes of the stiffness that a fast motion meets."""
    fast = max(
        (item.response(np.array([np.pi]))[0].real for item in loops), key=lambda item: np.abs(item).max()
    )
    found = [*asking, *np.linalg.eigh(fast + fast.T)[1].T]
    return [
        item for index, item in enumerate(found) if all(abs(item @ other) < 0.999 for other in found[:index])
    ]


def _ripple(loop: SpatialLoop, device: DeviceSettings) -> float:
    """Peak to peak force along an axis that the encoder's steps can keep up in a stable loop, in N.

    No bounded error gives more than its size times the 1-norm of the impulse responses from it, H (1 + P H)⁻¹: as of one
    axis (`lumbar.tissue.haptics.simulation.encoder_ripple`).
    """
    angles = np.linspace(0.0, np.pi, _LONGEST // 2 + 1)
    plant = loop_response(loop.unit, device)(angles)[:, None, None]
    model = np.fft.rfft(loop.impulse, _LONGEST, axis=0)
    closed = model @ np.linalg.inv(np.eye(model.shape[1]) + plant * model)
    size = np.abs(np.fft.irfft(closed, _LONGEST, axis=0)).sum(axis=(0, 2)).max()
    return float(size * device.encoder_um * 1e-6)


def _one_step(loop: SpatialLoop, device: DeviceSettings) -> float:
    """Largest force along an axis, in N, that sines of one encoder's step along every axis give."""
    return float(np.abs(loop.response(all_angles())).sum(axis=2).max() * device.encoder_um * 1e-6)


def _runs(
    fmu: UnzippedFmu,
    meets: RenderedModel,
    device: DeviceSettings,
    directions: Sequence[np.ndarray],
    ripple: float,
) -> list[LoopRun]:
    runs = []
    for direction in directions:
        for push_mm in PUSHES_MM:
            with stepping(fmu) as play:
                tick = TissueForce(meets.in_loop(play), meets.sampled[0].sampling_time)
                given = (repeat(1.0 / device.rate_Hz), device, meets.limit, 1e-3 * device.delay_ms, push_mm)
                points, samples = course(tick, *given, direction=direction)
                time, *signals = (np.array(values).T for values in (*zip(*points, strict=True), samples))
                runs += [LoopRun(time, *own, ripple, meets.limit) for own in zip(*signals, strict=True)]
    return runs
