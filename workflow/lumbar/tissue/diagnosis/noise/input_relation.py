"""Whether an error of a model has a relation to the input, or is noise of any colour, and which kind of noise.

Noise is independent of the input: hum, 1/f noise, spikes and a wandering zero explain none of its functions. The error of a model
that lacks an effect is a function of the input, even if the effect is in no catalogue. The whitened error is therefore projected
on whitened functions of the input (powers, directions, plays, and their lags), and the energy of the projection compared with χ².
"""

from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.tissue.diagnosis.noise.noise_floor import autocovariance, prediction_error_filter
from lumbar.tissue.diagnosis.noise.nonrepeating import smooth_power, taper
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.operators import play, relaxation

_ORDER = 20
"""Order of the autoregressive model of the error's colour."""
_MAX_SIGMAS = (4.0, 15.0)
"""Largest energy of the projection of noise, as a normal quantile: with an autoregressive colour, which hides an error at the one
frequency of the input, and with a colour from medians over bands, which shows it but is less exact."""
_CLIP_SIGMAS, _NORMAL_MEDIAN = 3.5, 0.6745
"""Standard deviations to which whitened errors are clipped; median of the absolute value of a standard normal variable."""
_SAMPLES_PER_FUNCTION = 3
"""Smallest number of samples per function of the input that distinguishes noise from a relation."""
_LAGS = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Time constants of lags of the position, in time scales of the motion; 1 and 10 of its nonlinear functions."""
_PLAYS = (0.1, 0.4)
"""Half-gaps of plays in standard deviations of the position."""
_LINE_SHARE, _SPIKE_SHARE, _SLOW_SHARE = 0.3, 0.3, 0.5
"""Shares of the error's power of the strongest line, of samples beyond `_SPIKE_SIGMAS`, and below `_SLOW_CYCLES` cycles."""
_SPIKE_SIGMAS, _SLOW_CYCLES = 6.0, 10


@dataclass(frozen=True, eq=False)
class ModelError:
    """Error of a model on one record."""

    values: np.ndarray
    """Error at the samples that count, shape (samples,)."""
    motion: Motion
    first: int
    """Index of the motion's first sample that counts."""


def is_related(errors: list[ModelError]) -> bool | None:
    """Return whether errors have a relation to the input; None if the records are too short to tell."""
    functions = [_functions_of_input(error.motion)[error.first :] for error in errors]
    pairs = list(zip(errors, functions, strict=True))
    pairs = [(error, bank) for error, bank in pairs if len(bank) > _SAMPLES_PER_FUNCTION * bank.shape[1]]
    if not pairs or pairs[0][0] is not errors[0]:
        return None
    for whitener, limit in zip((_autoregressive, _median_colour), _MAX_SIGMAS, strict=True):
        parts = [_projection(error, bank, whitener) for error, bank in pairs]
        energy, degrees, samples = (float(sum(column)) for column in zip(*parts, strict=True))
        probability = scipy.special.fdtrc(degrees, samples - degrees, energy / degrees)
        if -scipy.special.ndtri(max(probability, 1e-300)) > limit:
            return True
    return False


def _projection(error: ModelError, bank: np.ndarray, whitener) -> tuple[float, int, int]:
    """Return energy over variance, number of directions, and number of samples of the error along functions of the input."""
    values = error.values - error.values.mean()
    whiten, weights = whitener(values)
    white, columns = whiten(values), whiten(bank - bank.mean(axis=0))
    # A few spikes must not have the weight of thousands of samples.
    scale = np.median(np.abs(white / weights)) / _NORMAL_MEDIAN
    white = np.clip(white, -_CLIP_SIGMAS * scale * weights, _CLIP_SIGMAS * scale * weights)
    left, sizes, _ = np.linalg.svd(columns / np.maximum(np.std(columns, axis=0), 1e-300), full_matrices=False)
    left = left[:, sizes > 1e-5 * sizes[0]]
    along = float(np.sum((left.T @ white) ** 2))
    degrees, samples = left.shape[1], len(white)
    variance = max((float(white @ white) - along) / (samples - degrees), 1e-300)
    return along / variance, degrees, samples


def _autoregressive(values: np.ndarray):
    order = min(_ORDER, len(values) // 20)
    taps = prediction_error_filter(autocovariance(values, order) / len(values))[0]

    def whiten(signal: np.ndarray) -> np.ndarray:
        lagged = (tap * signal[order - lag : len(signal) - lag] for lag, tap in enumerate(taps))
        return sum(lagged)

    return whiten, np.ones(len(values) - order)


def _median_colour(values: np.ndarray):
    weights = taper(len(values))
    amplitude = np.sqrt(smooth_power(np.abs(np.fft.rfft(values * weights)) ** 2 / len(values), 1.0))

    def whiten(signal: np.ndarray) -> np.ndarray:
        spectrum = np.fft.rfft((signal.T * weights), axis=-1) / amplitude
        return np.fft.irfft(spectrum, len(values), axis=-1).T

    return whiten, weights


def _functions_of_input(motion: Motion) -> np.ndarray:
    """Return functions of the input that mechanisms of tissue and tool resemble, shape (samples, functions)."""
    spread = max(float(np.std(motion.position)), 1e-300)
    place = motion.replace_position((motion.position - np.mean(motion.position)) / spread)
    z, v = place.position, place.velocity / max(float(np.std(place.velocity)), 1e-300)
    direction, step = np.tanh(10 * v), motion.sampling_time
    shaped = [z**2, z**3, np.abs(z), direction, np.abs(v) * v, np.abs(v), z * v, z * np.abs(v)]
    shaped += [z * direction, z**2 * v, v**3, *(z - play(place, gap) for gap in _PLAYS)]
    scale = step / max(float(np.sqrt(np.mean(np.diff(z) ** 2))), 1e-300)
    linear = [z, v, np.gradient(v), *(_lag(place, z, scale * time) for time in _LAGS)]
    return np.column_stack(
        linear + shaped + [_lag(place, item, scale * t) for t in (1, 10) for item in shaped]
    )


def _lag(place: Motion, values: np.ndarray, time: float) -> np.ndarray:
    return relaxation(place.replace_position(values), time)


def kind_of_noise(values: np.ndarray, sampling_time: float) -> tuple[str, str]:
    """Return kind and description of the noise in an error that has no relation to the input.

    Parameters
    ----------
    values : numpy.ndarray, shape (samples,)
    sampling_time : float
        In seconds.
    """
    values = values - values.mean()
    power = np.abs(np.fft.rfft(values * taper(len(values)))) ** 2
    power[0] = 0.0
    peak, total = int(power.argmax()), max(float(power.sum()), 1e-300)
    if peak > _SLOW_CYCLES and power[peak - 2 : peak + 3].sum() > _LINE_SHARE * total:
        return "hum", f"mostly hum at {peak / (len(values) * sampling_time):.4g} Hz"
    spikes = np.abs(values) > _SPIKE_SIGMAS * np.median(np.abs(values)) / _NORMAL_MEDIAN
    if np.sum(values[spikes] ** 2) > _SPIKE_SHARE * np.sum(values**2):
        return "spikes", f"mostly in spikes of {int(spikes.sum())} samples"
    if power[: _SLOW_CYCLES + 1].sum() > _SLOW_SHARE * total:
        return "wandering_zero", "mostly slow, like a wandering zero"
    return "coloured_noise", "noise whose spectrum is not flat"
