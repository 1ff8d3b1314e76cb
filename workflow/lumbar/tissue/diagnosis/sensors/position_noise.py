"""Parts of a position that are not motion: noise, quantisation, jitter of the clock, acceleration without a force of the mass.

Noise does not depend on speed. The error of a sample that is δ too early or late is speed times δ. So the variance of the
position beyond the excitation's band is σ² + τ² v² at speed v, with the noise σ and the jitter τ.

The force of a moved mass is mass times acceleration. Noise that is hardly visible in a position is large in its second
derivative: the estimated mass is too small by the noise's share of the acceleration's power. Above the frequency at which the
force follows less than half of the acceleration, the position counts as noise.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from lumbar.base.formats import percent
from lumbar.records.record import Record
from lumbar.records.rests import find_levels
from lumbar.tissue.diagnosis.finding import Finding
from lumbar.tissue.diagnosis.sensors.bad_samples import Repair
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.signals.spectrum import spectral_edge, welch

_MIN_SEGMENTS = 6
_SEGMENT_LIMITS = (64, 4096)
"""Shortest and longest segment of the spectrum, in samples."""
_KAISER = 16.0
"""Shape of the segments' window: side lobes of −125 dB, below the noise of a sensor."""
_FLOOR_BAND = (0.7, 0.9)
"""Band in which the floor is measured, in Nyquist frequencies: above this band, filters of converters attenuate it."""
_MIN_FLOOR_RATIO = 4.0
"""Smallest ratio of the power of the excitation to that of the floor."""
_MEDIAN_BINS = 9
"""Number of bins of a median: more than half of them must be above the floor."""
_MAX_EDGE = 0.7
"""Highest edge, in Nyquist frequencies, with enough bandwidth above the edge."""
_TRANSITION = 0.25
"""Width of the filter's transition, as a share of the edge."""
_EXTENSION_PERIODS = 8.0
"""Length over which a signal is extrapolated beyond its ends, in periods of the edge."""
_MIN_SINGULAR_VALUE = 1e-3
"""Smallest singular value of the fitted extrapolation, relative to the largest."""


def edge_above_floor(values: np.ndarray, sampling_time: float) -> float | None:
    """Return the upper edge (Hz) of the band of an excitation, positions every `sampling_time` seconds; None without a floor.

    At the edge the spectrum falls to the flat floor of the sensor's noise. An edge by a share of the power (`spectral_edge`)
    would treat the weakest motion as noise.
    """
    if len(values) < _MIN_SEGMENTS * _SEGMENT_LIMITS[0]:
        return None
    length = int(np.clip(2 ** int(np.log2(len(values) / _MIN_SEGMENTS)), *_SEGMENT_LIMITS))
    frequency, power = welch(values, sampling_time, np.kaiser(length + 1, _KAISER)[:-1], degree=1)
    nyquist = 0.5 / sampling_time
    floor = np.median(
        power[(frequency >= _FLOOR_BAND[0] * nyquist) & (frequency <= _FLOOR_BAND[1] * nyquist)]
    )
    # Errors of a converter repeat with the excitation: single weak lines are theirs.
    smooth = np.pad(np.convolve(power, np.ones(3) / 3, "same"), _MEDIAN_BINS // 2)
    level = np.median(sliding_window_view(smooth, _MEDIAN_BINS), axis=1)
    above = np.flatnonzero(level[frequency <= _FLOOR_BAND[1] * nyquist] > _MIN_FLOOR_RATIO * floor)
    if not above.size or floor <= 0:
        return None
    edge = float(frequency[min(above[-1] + 2, len(frequency) - 1)])
    return edge if edge <= _MAX_EDGE * nyquist else None


def low_pass(values: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return a signal low-passed at an edge (Hz) with zero phase: gain 1 up to the edge, 0 above 1.25 edge.

    Beyond its ends the signal is extrapolated by frequencies within the band that fit the signal near the ends (Fourier
    continuation: Bruno, Han and Pohlman, J. Comput. Phys. 227 (2007) 1094-1125): a mirror image would ring.
    """
    reach = min(len(values) - 1, int(_EXTENSION_PERIODS / (edge * sampling_time)) + 1)
    mean = values.mean()
    rest = values - mean
    before = _continuation(rest[reach::-1], sampling_time, edge)[::-1]
    after = _continuation(rest[-reach - 1 :], sampling_time, edge)
    extended = np.concatenate([before, rest, after])
    length = scipy.fft.next_fast_len(len(extended), real=True)
    spectrum = scipy.fft.rfft(extended, length)
    # Gain 1 up to the edge, then half a period of a cosine down to 0.
    beyond_edge = np.clip((np.fft.rfftfreq(length, sampling_time) / edge - 1) / _TRANSITION, 0, 1)
    spectrum *= 0.5 + 0.5 * np.cos(np.pi * beyond_edge)
    return mean + scipy.fft.irfft(spectrum, length)[len(before) : len(before) + len(values)]


def _continuation(end: np.ndarray, sampling_time: float, edge: float) -> np.ndarray:
    """Return an extrapolation of a signal, of the same length, that fades to zero; shape (samples - 1,)."""
    size = len(end)
    harmonics = max(int(2 * size * sampling_time * edge), 1) + 1
    angle = np.pi * np.arange(2 * size - 1)[:, None] / size * np.arange(harmonics)
    basis = np.hstack([np.cos(angle), np.sin(angle[:, 1:])])
    extrapolated = basis[size:] @ np.linalg.lstsq(basis[:size], end, rcond=_MIN_SINGULAR_VALUE)[0]
    largest = 2 * np.abs(end).max()
    fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, size - 1) ** 2)
    return np.clip(extrapolated, -largest, largest) * fade


# Noise and jitter
_BINS = 24
_MAD = 1.4826
"""Ratio of the standard deviation of normal values to the median of their absolute values."""
_EFFICIENCY = 0.37
"""Statistical efficiency of the standard deviation by medians, as a share of the samples."""
_MIN_NOISE = 2e-5
"""Smallest noise that is considered, in standard deviations of the position."""
_MIN_FORCE_NOISE = 0.03
"""Smallest force, due to position noise through stiffness and damping, that is relevant, relative to the noise of the force."""
_RELEVANT_NOISE = 1e-3
"""Smallest noise that is relevant for effects of the sign of the speed, in standard deviations of the position."""
_MAX_TAIL_RATIO = 4.0
"""Largest ratio of the RMS to the standard deviation by medians of noise; at larger ratios the rest is corners of the motion."""
_MIN_LIKELIHOOD_RATIO = 20.0
"""Log-likelihood ratio above which both noise and jitter are needed."""
_MIN_PART = 0.1
"""Smallest share of a reported part in the variance beyond the band."""
# Noise at levels
_MAX_CHANCE_SIGMAS = 5.0
"""Largest correlation of noise with itself or the force, in standard errors."""
# Quantisation
_MIN_ON_STEPS = 0.9
"""Smallest share of the values of a quantised position that are on steps."""
_STEP_TOLERANCE = 0.05
"""Largest distance of a value from a step, in steps."""
_MAX_STEP_NOISE = 3.0
"""Largest ratio of the noise to that of quantisation if quantisation explains the noise, which is coloured at low speed."""
# Jitter
_FORCE_EDGE = 2.0
"""Ratio of the edges of the force's band and of the excitation's band, because a nonlinear tissue adds harmonics."""
_MIN_SHARED_SIGMAS = 5.0
"""Smallest part of the force, in standard errors, that the timing errors of the position explain."""
# Acceleration that a mass does not follow
_SEGMENTS = 12
_MIN_SEGMENT = 64
"""Number of samples of the shortest segment for a spectrum."""
_AVERAGED_FREQUENCIES = 9
"""Number of neighbouring frequencies over which spectra are averaged."""
_BAND_POWER = 0.99
"""Share of the force's power in the band from which the mass is estimated."""
_MIN_MASS_GAIN = 2.0
"""Smallest factor by which the squared error grows without the mass."""
_MIN_FOLLOWED_SHARE = 0.5
"""Smallest share of the acceleration that the force follows within the band."""
_END_PERIODS = 8.0
"""Length at both ends that is not filtered, in periods of the edge; the filter is faded in over another such length."""
_MIN_ROUGH_SHARE = 0.01
"""Share of the acceleration's power beyond the band above which it affects the estimate of a mass."""


@dataclass(frozen=True, eq=False)
class Roughness:
    """Parts of a position within and beyond the band of its excitation."""

    edge: float
    """Upper edge of the band, Hz."""
    smooth: np.ndarray
    """Position below the edge of the band, shape (samples,)."""
    rough: np.ndarray
    """Rest of the position, shape (samples,)."""
    speed: np.ndarray
    """Time derivative of `smooth` in the position's unit per second, shape (samples,)."""
    response: np.ndarray
    """Force above the edge of the band, shape (samples,)."""
    noise: float
    """Noise σ over the whole spectrum, in the position's unit; 0 if jitter explains the rough part."""
    jitter: float
    """Jitter τ in seconds RMS; 0 if noise explains the rough part."""

    @property
    def error_rms(self) -> float:
        """RMS error of the position due to noise and jitter."""
        return float(np.hypot(self.noise, self.jitter * np.sqrt(np.mean(self.speed**2))))

    def gain_at_edge(self, force: np.ndarray) -> float:
        """Return the size of stiffness and damping at the edge of the band, force over position."""
        columns = np.column_stack([np.ones(len(force)), self.smooth, self.speed])
        _, stiffness, damping = np.linalg.lstsq(columns, force, rcond=None)[0]
        return float(np.hypot(stiffness, 2 * np.pi * self.edge * damping))


def find_roughness(record: Record) -> Repair | None:
    """Find noise, quantisation or jitter of the position, and filter the position to the excitation's band."""
    rough = _measure_roughness(record)
    if rough is None:
        return None
    smooth = record.with_values(input=rough.smooth)
    step, channel = _quantisation(record["input"], rough.error_rms), record.channels["input"]
    position, force = channel.quantity, record.channels["output"].quantity
    filtered = f"Frequencies above {rough.edge:.3g} Hz were filtered out before fitting"
    if step:  # the rest of a staircase grows with speed like an error of jitter
        sentence = (
            f"{record.name}: the {position} is quantised in steps of {step:.3g} {channel.unit}. {filtered}; use the sensor's "
            "full resolution."
        )
        return Repair(smooth, (Finding("quantisation", sentence, step, channel.unit, record.name),))
    findings = []
    if rough.noise > 0:
        # If the force follows the position beyond the band, the position is motion and not noise. Only samples at low speed
        # are used, because jitter of the clock at high speed makes both channels deviate together.
        slow = np.abs(rough.speed) <= np.median(np.abs(rough.speed))
        columns = np.column_stack([rough.rough, np.gradient(rough.rough, record.sampling_time)])[slow]
        fitted = columns @ np.linalg.lstsq(columns, rough.response[slow], rcond=None)[0]
        explained, left = np.sum(fitted**2), np.sum((rough.response[slow] - fitted) ** 2)
        expected = rough.gain_at_edge(record["output"]) ** 2 * np.sum(columns[:, 0] ** 2)
        if explained > 25.0 * left / slow.sum() and explained > 0.25 * expected:
            return None
        sentence = (
            f"{record.name}: the {position} has noise of {rough.noise:.2g} {channel.unit} RMS that the {force} does not follow. "
            f"{filtered}; use a quieter sensor or a filter before it."
        )
        findings.append(Finding("position_noise", sentence, rough.noise, channel.unit, record.name))
    if rough.jitter > 0:
        error = rough.jitter * float(np.sqrt(np.mean(rough.speed**2)))
        sentence = (
            f"{record.name}: the sampling times have a jitter of {1e3 * rough.jitter:.2g} ms RMS; the {position} is wrong in "
            f"proportion to speed, by {error:.2g} {channel.unit} RMS. {filtered}; let a hardware clock start the samples, or "
            "record their times."
        )
        findings.append(Finding("jitter", sentence, 1e3 * rough.jitter, "ms", record.name))
        smooth = _subtract_jitter(smooth, rough)
    return Repair(smooth, tuple(findings)) if findings else None


def find_level_noise(record: Record) -> Repair | None:
    """Find white noise of a position that rests at commanded levels, and put every level in place of its samples.

    Deviations from the levels that depend on each other, or that the force follows, are motion.
    """
    levels = find_levels(record["input"])
    if levels is None:
        return None
    values, rests = record["input"], levels.resting
    nearest = levels.values[np.abs(values[:, None] - levels.values).argmin(axis=1)]
    deviation = np.where(rests, values - nearest, 0.0)
    noise = float(np.sqrt(np.mean(deviation[rests] ** 2)))
    # Ends of moves are far from the level in few samples.
    is_tail = noise > _MAX_TAIL_RATIO * _robust_deviation(deviation[rests])
    if is_tail or noise <= _MIN_NOISE * np.std(values):
        return None
    both = rests[1:] & rests[:-1] & (np.diff(nearest) == 0)
    dependence = float(np.corrcoef(deviation[1:][both], deviation[:-1][both])[0, 1])
    followed = float(np.corrcoef(np.diff(deviation)[both], np.diff(record["output"])[both])[0, 1])
    if max(abs(dependence), abs(followed)) > _MAX_CHANCE_SIGMAS / np.sqrt(both.sum()):
        return None
    channel, force = record.channels["input"], record.channels["output"].quantity
    sentence = (
        f"{record.name}: the {channel.quantity} at its levels has noise of {noise:.2g} {channel.unit} RMS that the {force} does "
        "not follow. Its samples were replaced by the levels' means before fitting."
    )
    finding = Finding("position_noise", sentence, noise, channel.unit, record.name)
    return Repair(record.with_values(input=np.where(rests, nearest, values)), (finding,))


def _subtract_jitter(record: Record, rough: Roughness) -> Record:
    """Subtract the effect of the position's jitter from the force.

    The timing errors are r v / (v² + λ), with the position r beyond the band, the speed v, and λ from the noise. If force and
    position were sampled together, the error of the force is its rate of change times the timing error.
    """
    step, force = record.sampling_time, record["output"]
    edge = min(_FORCE_EDGE * rough.edge, 0.39 / step)
    slack = 0.1 * np.mean(rough.speed**2) + (rough.noise / rough.jitter) ** 2
    late = rough.rough * rough.speed / (rough.speed**2 + slack)
    smooth = low_pass(force, step, edge)
    effect = late * np.gradient(smooth, step)
    rest = force - smooth
    fast_effect = effect - low_pass(effect, step, edge)
    energy = np.maximum(fast_effect @ fast_effect, 1e-300)
    gain = float(fast_effect @ rest / energy)
    error = float(np.std(rest - gain * fast_effect) / np.sqrt(energy))
    shared = gain if gain > _MIN_SHARED_SIGMAS * error else 0.0
    return record.with_values(output=force - shared * effect)


def _measure_roughness(record: Record) -> Roughness | None:
    """Split a position at the edge of its band; None if the rest is irrelevant or only rough in places."""
    values, force, step = record["input"], record["output"], record.sampling_time
    edge = edge_above_floor(values, step)
    if edge is None:
        return None
    smooth = low_pass(values, step, edge)
    rough, speed = values - smooth, np.gradient(smooth, step)
    deviation = _robust_deviation(rough)
    if deviation <= _MIN_NOISE * np.std(values) or np.sqrt(np.mean(rough**2)) > _MAX_TAIL_RATIO * deviation:
        return None
    # Squares of the impulse response that leaves only the part beyond the edge.
    reach = int(8 / (edge * step)) + 8
    impulse = np.zeros(4 * reach + 1)
    impulse[2 * reach] = 1.0
    taps = (impulse - low_pass(impulse, step, edge))[reach : 3 * reach + 1] ** 2
    response = force - low_pass(force, step, edge)
    result = Roughness(edge, smooth, rough, speed, response, *_noise_and_jitter(rough, speed, taps))
    # Noise is relevant if it is large relative to the motion, or changes a modelled force by a part of the force's noise.
    if result.error_rms > _RELEVANT_NOISE * np.std(smooth):
        return result
    least = _MIN_FORCE_NOISE * _robust_deviation(response) / np.sqrt(float(np.sum(taps)))
    return result if result.gain_at_edge(force) * result.error_rms > least else None


def _robust_deviation(values: np.ndarray) -> float:
    return _MAD * float(np.median(np.abs(values)))


def _noise_and_jitter(rough: np.ndarray, speed: np.ndarray, taps: np.ndarray) -> tuple[float, float]:
    """Return σ and τ of Var r[n] = Σₖ g[k]² (σ² + τ² v[n−k]²), with the filter's `taps` g²; an unnecessary parameter is 0."""
    share, power = float(taps.sum()), np.maximum(scipy.signal.fftconvolve(speed**2, taps, "same"), 0.0)
    groups = [group for group in np.array_split(np.argsort(power), _BINS) if group.size]
    variances = np.array([_robust_deviation(rough[group]) ** 2 for group in groups])
    variances = np.maximum(variances, 1e-12 * variances.max())
    moved = np.array([power[group].mean() for group in groups])
    both = np.column_stack([np.full(len(moved), share), moved])
    weight = 0.5 * share * _EFFICIENCY * len(rough) / len(groups)
    fits, loss = {}, {}
    for name, columns in {"both": both, "noise": both * [1, 0], "jitter": both * [0, 1]}.items():
        # Coefficients that are not negative, by least squares weighted with the expected variances; loss by deviance.
        expected, fitted = variances, np.zeros(2)
        for _ in range(8):
            fitted = scipy.optimize.nnls(columns / expected[:, None], variances / expected)[0]
            expected = np.maximum(columns @ fitted, 1e-6 * variances.max())
        ratio = variances / expected
        fits[name], loss[name] = fitted, weight * float(np.sum(ratio - 1 - np.log(ratio)))
    parts = fits["both"] * both.mean(axis=0)
    needed = min(loss["noise"], loss["jitter"]) - loss["both"] > _MIN_LIKELIHOOD_RATIO
    needs_both = needed and parts.min() > _MIN_PART * parts.sum()
    single = min(("noise", "jitter"), key=loss.get)
    noise, jitter = np.sqrt(fits["both" if needs_both else single])
    return float(noise), float(jitter)


def _quantisation(values: np.ndarray, noise: float) -> float | None:
    """Return the step of quantised values if it explains noise of this RMS (step over √12), else None."""
    levels, counts = np.unique(values, return_counts=True)
    often = levels[counts > 1] if np.mean(counts > 1) > 0.5 else levels
    gaps = np.diff(often)
    gaps = gaps[gaps > 1e-9 * np.ptp(values)]
    if not gaps.size:
        return None
    step = float(np.quantile(gaps, 0.1))
    near = gaps[np.abs(gaps / step - 1) < 2 * _STEP_TOLERANCE]
    step = float(near.mean())
    # The mean of many gaps is finer than the step's rounding; over the whole range it must still give their number.
    step = float(np.ptp(often) / max(round(np.ptp(often) / step), 1))
    places = (values - often[0]) / step
    on_steps = np.mean(np.abs(places - np.round(places)) < _STEP_TOLERANCE)
    explains = noise <= _MAX_STEP_NOISE * step / np.sqrt(12)
    return step if on_steps >= _MIN_ON_STEPS and explains else None


def find_rough_acceleration(record: Record) -> Repair | None:
    """Find acceleration that the force of a moved mass does not follow; None without mass or with little such acceleration.

    The position is not changed within the band that the force follows, nor at both ends, at which errors of the filter would be
    large after two derivatives.
    """
    length = 2 ** int(np.log2(max(len(record) / _SEGMENTS, 1)))
    mass = _mass(record) if length >= _MIN_SEGMENT else None
    if mass is None:
        return None
    rate = 1 / record.sampling_time
    acceleration, force = Motion.from_record(record).acceleration, record["output"]
    frequency, power = scipy.signal.welch(acceleration, rate, nperseg=length)
    cross_power = scipy.signal.csd(acceleration, force, rate, nperseg=length)[1].real
    average = np.ones(_AVERAGED_FREQUENCIES) / _AVERAGED_FREQUENCIES
    followed = np.convolve(cross_power, average, "same") / np.convolve(power, average, "same") / mass
    inside = np.flatnonzero(followed >= _MIN_FOLLOWED_SHARE)
    if not inside.size or inside[-1] + 1 >= len(frequency):
        return None
    edge = float(frequency[inside[-1] + 1])
    share = float(power[frequency > edge].sum() / power.sum())
    if share <= _MIN_ROUGH_SHARE:
        return None
    quantity, output = (record.channels[role].quantity for role in ("input", "output"))
    sentence = (
        f"{record.name}: {percent(share)} of the power of the {quantity}'s second derivative is above {edge:.3g} Hz, where "
        f"the {output} does not follow it. This noise would make a mass too small by the same share; it was filtered out "
        "before fitting."
    )
    finding = Finding("rough_acceleration", sentence, edge, "Hz", record.name)
    position, step = record["input"], record.sampling_time
    rough = position - low_pass(position, step, edge)
    from_end = np.minimum(np.arange(len(position)), np.arange(len(position))[::-1])
    inside = np.clip(from_end * step * edge / _END_PERIODS - 1, 0, 1)
    smooth = position - np.sin(0.5 * np.pi * inside) ** 2 * rough
    return Repair(record.with_values(input=smooth), (finding,))


def _mass(record: Record) -> float | None:
    """Return the mass by which the force follows the acceleration, in the records' units; None if it does not."""
    force, step = record["output"], record.sampling_time
    edge = spectral_edge(force - force.mean(), _BAND_POWER) / step
    if 4 * edge * step > 1:
        return None
    smooth = low_pass(record["input"], step, edge)
    speed = np.gradient(smooth, step)
    columns = np.column_stack([np.ones(len(force)), smooth, speed, np.gradient(speed, step)])
    fitted, errors = np.linalg.lstsq(columns, force, rcond=None)[:2]
    without = np.linalg.lstsq(columns[:, :-1], force, rcond=None)[1]
    has_mass = errors.size and without.size and fitted[-1] > 0 and without[0] > _MIN_MASS_GAIN * errors[0]
    return float(fitted[-1]) if has_mass else None
