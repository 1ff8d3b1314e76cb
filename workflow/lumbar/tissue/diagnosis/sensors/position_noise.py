"""Parts of a position that are not motion: noise, quantisation, jitter of the clock, acceleration that no mass follows.

Noise is there whether the tool moves or not. A sample taken δ too early or late is off by speed times δ. So the variance of
what lies beyond the excitation's band is, at speed v, σ² + τ² v², with σ of the noise and τ of the jitter.

Where a mass is moved, force is mass times acceleration. Noise of a position that is too small to be seen in it is large derived
twice: it makes the mass come out too small, by its share of the acceleration's power, and the interval with it. From the
frequency on at which the force follows less than half of the acceleration, the position is taken for noise.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.bad_samples import Repair
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import spectral_edge, welch

_FEWEST_SEGMENTS = 6
_SEGMENT = (64, 4096)
"""Shortest and longest segment of the spectrum, in samples."""
_KAISER = 16.0
"""Shape of the segments' window: side lobes of −125 dB, below what noise of a sensor leaves."""
_FLOOR = (0.7, 0.9)
"""Band in which the floor is read, in Nyquist frequencies: above it filters of converters fall off."""
_ABOVE_FLOOR = 4.0
"""Power over the floor's that belongs to the excitation."""
_LONE_LINES = 9
"""Number of bins of which more than half must be above the floor."""
_HIGHEST = 0.7
"""Highest edge, in Nyquist frequencies, with enough bandwidth above it."""
_TRANSITION = 0.25
"""Width of the filter's transition, as a share of the edge."""
_REACH = 8.0
"""Length over which a signal is carried on beyond its ends, in periods of the edge."""
_CONTINUES = 1e-3
"""Smallest singular value, of the largest, of what is fitted for that."""


def edge_above_floor(values: np.ndarray, sampling_time: float) -> float | None:
    """Return the upper edge (Hz) of an excitation's band; None where no level floor follows it.

    Where the spectrum falls to the floor that a sensor adds, not where a share of the power lies (`spectral_edge`): of the
    weakest motion nothing may be mistaken for noise.

    `values` are positions, shape (samples,), every `sampling_time` seconds.
    """
    if len(values) < _FEWEST_SEGMENTS * _SEGMENT[0]:
        return None
    length = int(np.clip(2 ** int(np.log2(len(values) / _FEWEST_SEGMENTS)), *_SEGMENT))
    frequency, power = welch(values, sampling_time, np.kaiser(length + 1, _KAISER)[:-1], degree=1)
    nyquist = 0.5 / sampling_time
    floor = np.median(power[(frequency >= _FLOOR[0] * nyquist) & (frequency <= _FLOOR[1] * nyquist)])
    # Errors of a converter repeat with the excitation: single lines that stand out little are theirs.
    smooth = np.pad(np.convolve(power, np.ones(3) / 3, "same"), _LONE_LINES // 2)
    level = np.median(sliding_window_view(smooth, _LONE_LINES), axis=1)
    above = np.flatnonzero(level[frequency <= _FLOOR[1] * nyquist] > _ABOVE_FLOOR * floor)
    if not above.size or floor <= 0:
        return None
    edge = frequency[min(above[-1] + 2, len(frequency) - 1)]
    if edge > _HIGHEST * nyquist:
        return None
    return float(edge)


def within_band(values: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return a signal without what lies beyond an edge, with zero phase: gain 1 up to the edge, 0 from 1.25 edge on.

    Beyond its ends the signal is carried on by what fits it there and has no other frequencies (Fourier continuation:
    Bruno, Han and Pohlman, J. Comput. Phys. 227 (2007) 1094-1125): a mirror image would bend sharply at the end, and ring.

    `values` have shape (samples,), every `sampling_time` seconds; `edge` is in Hz.
    """
    reach = min(len(values) - 1, int(_REACH / (edge * sampling_time)) + 1)
    mean = values.mean()
    rest = values - mean
    before = _continuation(rest[reach::-1], sampling_time, edge)[::-1]
    after = _continuation(rest[-reach - 1 :], sampling_time, edge)
    extended = np.concatenate([before, rest, after])
    length = scipy.fft.next_fast_len(len(extended), real=True)
    spectrum = scipy.fft.rfft(extended, length)
    # Gain 1 up to the edge, then half a period of a cosine down to 0.
    beyond = np.clip((np.fft.rfftfreq(length, sampling_time) / edge - 1) / _TRANSITION, 0, 1)
    spectrum *= 0.5 + 0.5 * np.cos(np.pi * beyond)
    return mean + scipy.fft.irfft(spectrum, length)[len(before) : len(before) + len(values)]


def _continuation(end: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return an extrapolation of a signal, of the same length, that fades to zero; shape (samples - 1,)."""
    size = len(end)
    harmonics = max(int(2 * size * sampling_time * edge), 1) + 1
    angle = np.pi * np.arange(2 * size - 1)[:, None] / size * np.arange(harmonics)
    basis = np.hstack([np.cos(angle), np.sin(angle[:, 1:])])
    follows = basis[size:] @ np.linalg.lstsq(basis[:size], end, rcond=_CONTINUES)[0]
    largest = 2 * np.abs(end).max()
    fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, size - 1) ** 2)
    return np.clip(follows, -largest, largest) * fade


# Noise and jitter
_BINS = 24
_MAD = 1.4826
"""Standard deviation of normal values over their median size."""
_EFFICIENCY = 0.37
"""Efficiency of that estimate: the share of the samples that it uses."""
_LEAST = 2e-5
"""Smallest noise that is considered, in standard deviations of the position."""
_MATTERS = 0.03
"""Smallest relevant noise, through stiffness and damping, relative to the noise of the force."""
_MATTERS_ANYHOW = 1e-3
"""Noise that is relevant for effects of the sign of the speed, in standard deviations of the position."""
_CONCENTRATED = 4.0
"""Ratio of the RMS to the standard deviation by medians above which the rest is corners of the motion, not noise."""
_SURE = 20.0
"""Log-likelihood ratio above which noise or jitter only is not enough."""
_PART = 0.1
"""Smallest share of the variance beyond the band of a reported part."""
# Quantisation
_ON_STEPS = 0.9
"""Share of the values that lie on steps."""
_WITHIN = 0.05
"""Largest distance of a value from a step, in steps."""
_EXPLAINS = 3.0
"""Noise over that of the steps, up to which they explain it: at low speed it is coloured."""
# Jitter
_FORCE_EDGE = 2.0
"""Edge of the force's band over that of the excitation: a nonlinear tissue answers at harmonics too."""
_SHARED = 5.0
"""Standard errors by which the force must be off by its own rate of change times the same times."""
# Acceleration that a mass does not follow
_SEGMENTS = 12
_SHORTEST = 64
"""Samples of the shortest segment whose spectrum is taken."""
_SMOOTHED = 9
"""Neighbouring frequencies whose spectra are taken together."""
_BAND_POWER = 0.99
"""Share of the force's power in the band from which the mass is estimated."""
_INERTIAL = 2.0
"""Smallest factor by which the squared error grows without the mass if there is one."""
_FOLLOWED = 0.5
"""Share of the acceleration that the force follows within the band."""
_END = 8.0
"""Length at both ends, in periods of the edge, that is not filtered; over the same length the filter sets in."""
_ROUGH_SHARE = 0.01
"""Share of the acceleration's power beyond the band above which the estimate of a mass is affected."""


@dataclass(frozen=True, eq=False)
class Roughness:
    """The part of a position beyond the band of its excitation."""

    edge: float
    """Hz."""
    smooth: np.ndarray
    rough: np.ndarray
    speed: np.ndarray
    answer: np.ndarray
    """`smooth`, `rough`, `speed`, `answer`: shape (samples,): the position within its band, the rest of it, the speed (per
    second), and the force beyond that band."""
    noise: float
    """σ, in the position's unit, over the whole of the spectrum; 0 where the jitter is enough."""
    jitter: float
    """τ, in seconds RMS; 0 where the noise is enough."""

    @property
    def moves(self) -> float:
        """RMS of what noise and jitter do to the position."""
        return float(np.hypot(self.noise, self.jitter * np.sqrt(np.mean(self.speed**2))))


def find_roughness(record: Record) -> Repair | None:
    """Find noise, quantisation or jitter of the position; filter out what is beyond the excitation's band."""
    found = _roughness(record)
    if found is None:
        return None
    smooth = record.with_values(input=found.smooth)
    step, channel = _quantisation(record["input"], found.moves), record.channels["input"]
    position, force = channel.quantity, record.channels["output"].quantity
    filtered = f"Frequencies above {found.edge:.3g} Hz were filtered out before fitting"
    if step:  # what is left of a staircase grows with speed as what jitter does
        sentence = (
            f"{record.name}: the {position} is quantised in steps of {step:.3g} {channel.unit}. {filtered}; use the sensor's "
            "full resolution."
        )
        return Repair(smooth, (Finding("quantisation", sentence, step, channel.unit, record.name),))
    if found.noise > 0 and _is_motion(found, record):
        return None
    findings = []
    if found.noise > 0:
        sentence = (
            f"{record.name}: the {position} has noise of {found.noise:.2g} {channel.unit} RMS that the {force} does not follow. "
            f"{filtered}; use a quieter sensor or a filter before it."
        )
        findings.append(Finding("position_noise", sentence, found.noise, channel.unit, record.name))
    if found.jitter > 0:
        moved = found.jitter * float(np.sqrt(np.mean(found.speed**2)))
        sentence = (
            f"{record.name}: the sampling times have a jitter of {1e3 * found.jitter:.2g} ms RMS; the {position} is wrong in "
            f"proportion to speed, by {moved:.2g} {channel.unit} RMS. {filtered}; let a hardware clock start the samples, or "
            "record their times."
        )
        findings.append(Finding("jitter", sentence, 1e3 * found.jitter, "ms", record.name))
        smooth = _without_jitter(smooth, found)
    return Repair(smooth, tuple(findings)) if findings else None


def _without_jitter(record: Record, found: Roughness) -> Record:
    """Subtract the effect of the position's jitter from the force.

    The timing errors are r v / (v² + λ), with r the position beyond the band and λ from its noise; the error of the force is its
    rate of change times them, if it was sampled with the position.
    """
    step, force = record.sampling_time, record["output"]
    edge = min(_FORCE_EDGE * found.edge, 0.39 / step)
    slack = 0.1 * np.mean(found.speed**2) + (found.noise / found.jitter) ** 2
    late = found.rough * found.speed / (found.speed**2 + slack)
    smooth = within_band(force, step, edge)
    effect = late * np.gradient(smooth, step)
    rough = force - smooth
    beyond = effect - within_band(effect, step, edge)
    gain = float(beyond @ rough / np.maximum(beyond @ beyond, 1e-300))
    error = float(np.std(rough - gain * beyond) / np.sqrt(np.maximum(beyond @ beyond, 1e-300)))
    shared = gain if gain > _SHARED * error else 0.0
    return record.with_values(output=force - shared * effect)


def _roughness(record: Record) -> Roughness | None:
    """Split a position at the edge of its band; None where nothing is left beyond it that matters and is rough all along."""
    values, step = record["input"], record.sampling_time
    edge = edge_above_floor(values, step)
    if edge is None:
        return None
    smooth = within_band(values, step, edge)
    rough, speed = values - smooth, np.gradient(smooth, step)
    usual = _robust_deviation(rough)
    if usual <= _LEAST * np.std(values) or np.sqrt(np.mean(rough**2)) > _CONCENTRATED * usual:
        return None
    noise, jitter = _noise_and_jitter(rough, speed, step, edge)
    answer = record["output"] - within_band(record["output"], step, edge)
    found = Roughness(edge, smooth, rough, speed, answer, noise, jitter)
    return found if _matters(found, record) else None


def _robust_deviation(values: np.ndarray) -> float:
    return _MAD * float(np.median(np.abs(values)))


def _noise_and_jitter(rough: np.ndarray, speed: np.ndarray, step: float, edge: float) -> tuple[float, float]:
    """σ and τ of Var r[n] = Σₖ g[k]² (σ² + τ² v[n−k]²), with g the filter that left r; one is 0 where the other is enough."""
    taps = _response_beyond(step, edge) ** 2
    share, power = float(taps.sum()), np.maximum(scipy.signal.fftconvolve(speed**2, taps, "same"), 0.0)
    order = np.argsort(power)
    groups = [group for group in np.array_split(order, _BINS) if group.size]
    found = np.array([_robust_deviation(rough[group]) ** 2 for group in groups])
    found = np.maximum(found, 1e-12 * found.max())
    moved = np.array([power[group].mean() for group in groups])
    weight = 0.5 * share * _EFFICIENCY * len(rough) / len(groups)
    bases = {"both": np.column_stack([np.full(len(moved), share), moved])}
    bases["noise"], bases["jitter"] = bases["both"] * [1, 0], bases["both"] * [0, 1]
    fits = {name: _variances(columns, found) for name, columns in bases.items()}
    loss = {name: weight * _deviance(bases[name] @ fits[name], found) for name in fits}
    sure = {name: loss[name] - loss["both"] > _SURE for name in ("noise", "jitter")}
    alone = min(("noise", "jitter"), key=loss.get)
    parts = fits["both"] * bases["both"].mean(axis=0)
    both = sure["noise"] and sure["jitter"] and parts.min() > _PART * parts.sum()
    noise, jitter = np.sqrt(fits["both" if both else alone])
    return float(noise), float(jitter)


def _variances(columns: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Not negative coefficients of variances, each weighed by what it is expected to be."""
    expected, fitted = found, np.zeros(columns.shape[1])
    for _ in range(8):
        fitted = scipy.optimize.nnls(columns / expected[:, None], found / expected)[0]
        expected = np.maximum(columns @ fitted, 1e-6 * found.max())
    return fitted


def _deviance(expected: np.ndarray, found: np.ndarray) -> float:
    """Return the deviance of variances: Σ s²/σ² − 1 − ln s²/σ²."""
    ratio = found / np.maximum(expected, 1e-6 * found.max())
    return float(np.sum(ratio - 1 - np.log(ratio)))


def _response_beyond(step: float, edge: float) -> np.ndarray:
    """Impulse response of what leaves only what lies beyond the edge."""
    reach = int(8 / (edge * step)) + 8
    impulse = np.zeros(4 * reach + 1)
    impulse[2 * reach] = 1.0
    response = impulse - within_band(impulse, step, edge)
    return response[reach : 3 * reach + 1]


def _matters(found: Roughness, record: Record) -> bool:
    """Return whether noise or jitter changes a modelled force by a part of its noise, or is large relative to the motion."""
    if found.moves > _MATTERS_ANYHOW * np.std(found.smooth):
        return True
    force, step = record["output"], record.sampling_time
    share = float(np.sum(_response_beyond(step, found.edge) ** 2))
    return _gain_at_edge(found, force) * found.moves > _MATTERS * _robust_deviation(found.answer) / np.sqrt(
        share
    )


def _gain_at_edge(found: Roughness, force: np.ndarray) -> float:
    """Size of stiffness and damping at the edge of the band, force over position."""
    columns = np.column_stack([np.ones(len(force)), found.smooth, found.speed])
    _, stiffness, damping = np.linalg.lstsq(columns, force, rcond=None)[0]
    return float(np.hypot(stiffness, 2 * np.pi * found.edge * damping))


def _is_motion(found: Roughness, record: Record) -> bool:
    """Return whether the force follows the position beyond the band: then the tool moves so, and no sensor is at fault.

    From samples at low speed, at which jitter of the clock does not make both channels deviate in the same way.
    """
    force, step = record["output"], record.sampling_time
    slow = np.abs(found.speed) <= np.median(np.abs(found.speed))
    columns = np.column_stack([found.rough, np.gradient(found.rough, step)])[slow]
    fitted = columns @ np.linalg.lstsq(columns, found.answer[slow], rcond=None)[0]
    explained, left = np.sum(fitted**2), np.sum((found.answer[slow] - fitted) ** 2)
    expected = _gain_at_edge(found, force) ** 2 * np.sum(columns[:, 0] ** 2)
    return bool(explained > 25.0 * left / slow.sum() and explained > 0.25 * expected)


def _quantisation(values: np.ndarray, noise: float) -> float | None:
    """Step of quantised values, where it explains noise of this RMS (step over √12), or None."""
    levels, counts = np.unique(values, return_counts=True)
    often = levels[counts > 1] if np.mean(counts > 1) > 0.5 else levels
    gaps = np.diff(often)
    gaps = gaps[gaps > 1e-9 * np.ptp(values)]
    if not gaps.size:
        return None
    step = float(np.quantile(gaps, 0.1))
    near = gaps[np.abs(gaps / step - 1) < 2 * _WITHIN]
    step = float(near.mean())
    # The mean of many gaps is finer than the step's rounding; over the whole range it still has to count them right.
    step = float(np.ptp(often) / max(round(np.ptp(often) / step), 1))
    places = (values - often[0]) / step
    on_steps = np.mean(np.abs(places - np.round(places)) < _WITHIN)
    explains = noise <= _EXPLAINS * step / np.sqrt(12)
    return step if on_steps >= _ON_STEPS and explains else None


def find_rough_acceleration(record: Record) -> Repair | None:
    """Find acceleration that the force of a moved mass does not follow; None where no mass is moved, or little of it is noise.

    The position is left as it is within the band that the force follows, and at both ends: there what the filter adds is small
    compared with the position, but not after two derivatives.
    """
    length = 2 ** int(np.log2(max(len(record) / _SEGMENTS, 1)))
    mass = _mass(record) if length >= _SHORTEST else None
    if mass is None:
        return None
    rate = 1 / record.sampling_time
    acceleration, force = Motion.of(record).acceleration, record["output"]
    frequency, power = scipy.signal.welch(acceleration, rate, nperseg=length)
    crossed = scipy.signal.csd(acceleration, force, rate, nperseg=length)[1].real
    together = np.ones(_SMOOTHED) / _SMOOTHED
    followed = np.convolve(crossed, together, "same") / np.convolve(power, together, "same") / mass
    inside = np.flatnonzero(followed >= _FOLLOWED)
    if not inside.size or inside[-1] + 1 >= len(frequency):
        return None
    edge = float(frequency[inside[-1] + 1])
    share = float(power[frequency > edge].sum() / power.sum())
    if share <= _ROUGH_SHARE:
        return None
    quantity, followed_by = (record.channels[role].quantity for role in ("input", "output"))
    sentence = (
        f"{record.name}: {100 * share:.2g} % of the power of the {quantity}'s second derivative is above {edge:.3g} Hz, where "
        f"the {followed_by} does not follow it. This noise would make a mass too small by the same share; it was filtered out "
        "before fitting."
    )
    finding = Finding("rough_acceleration", sentence, edge, "Hz", record.name)
    position, step = record["input"], record.sampling_time
    rough = position - within_band(position, step, edge)
    from_end = np.minimum(np.arange(len(position)), np.arange(len(position))[::-1])
    inside = np.clip(from_end * step * edge / _END - 1, 0, 1)
    smooth = position - np.sin(0.5 * np.pi * inside) ** 2 * rough
    return Repair(record.with_values(input=smooth), (finding,))


def _mass(record: Record) -> float | None:
    """Mass by which the force follows the acceleration, in the records' units; None where there is none."""
    force, step = record["output"], record.sampling_time
    edge = spectral_edge(force - force.mean(), _BAND_POWER) / step
    if 4 * edge * step > 1:
        return None
    smooth = within_band(record["input"], step, edge)
    speed = np.gradient(smooth, step)
    columns = np.column_stack([np.ones(len(force)), smooth, speed, np.gradient(speed, step)])
    fitted, errors = np.linalg.lstsq(columns, force, rcond=None)[:2]
    without = np.linalg.lstsq(columns[:, :-1], force, rcond=None)[1]
    moved = errors.size and without.size and fitted[-1] > 0 and without[0] > _INERTIAL * errors[0]
    return float(fitted[-1]) if moved else None
