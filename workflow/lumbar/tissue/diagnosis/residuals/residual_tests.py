"""Tests of a simulation's residual: whether it is noise, what it is related to, and which cause is told from the others.

A residual that is related to the input holds dynamics or nonlinearity that a better model would explain (Ljung,
System Identification, 2nd ed., section 16.6). Even functions of the input, z² and |v|, show what a correlation with the
input itself cannot: a force that is not mirrored when the motion is (Billings and Voon, Int. J. Control 44, 1986).
Limits follow from the noise's spectrum and the function's own, so they hold for coloured noise too.

Any force that follows the motion resembles linear dynamics on one record, its best linear approximation, but others on other
excitation (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 3); and refitting a base
leaves a linear part whatever is missing. So linear dynamics are fitted once to the error of all records, and every other cause
beside them: what it takes of what they leave tells it from them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from lumbar.tissue.diagnosis.noise.noise_floor import autocovariance
from lumbar.tissue.diagnosis.residuals.motion_diagnostics import (
    DEPTHS,
    binned,
    map_edges,
    reversals,
    spread_edges,
)
from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Residual,
    View,
    chi_square_p,
    only,
    percent,
    probability,
    said,
)
from lumbar.tissue.diagnosis.residuals.time_frequency import time_edges, time_view
from lumbar.tissue.models.transfer_function import filtered

_NORMAL_975 = 1.959964
_WHITENESS_LAGS = 20
_LAGS = 25
_RELAXATIONS = 8
"""Time constants, spread evenly in logarithm, that span linear dynamics."""
_MOSTLY = 0.8
_WEAK = 0.3
"""Correlations below this share of the largest are weak beside it, however significant."""
LINEAR_FUNCTIONS = ("z", "v")
EVEN_FUNCTIONS = ("z²", "|v|")
ODD_FUNCTIONS = ("z³", "sign v", "v|v|")


def ljung_box(values: np.ndarray, lags: int) -> tuple[float, float]:
    """Ljung–Box statistic N(N+2) Σ ρ²/(N−k) and its p-value with `lags` degrees of freedom (Biometrika 65, 1978)."""
    size = len(values)
    covariance = autocovariance(values - values.mean(), lags)
    if covariance[0] <= 0:
        return 0.0, 1.0
    correlation = covariance[1:] / covariance[0]
    statistic = float(size * (size + 2) * np.sum(correlation**2 / (size - np.arange(1, lags + 1))))
    return statistic, float(scipy.special.chdtrc(lags, statistic))


def whiteness_view(residual: Residual) -> View:
    """Ljung–Box test of the residual, whitened by the noise's spectrum where the noise is coloured.

    Columns ``lag`` (s), ``correlation`` and ``limit`` (95 %).
    """
    whitened = np.convolve(residual.values, residual.whitening, mode="valid")
    lags = min(_WHITENESS_LAGS, len(whitened) // 5)
    _, p_value = ljung_box(whitened, lags)
    centred = whitened - whitened.mean()
    energy = np.sum(centred**2)
    correlation = np.array([centred[lag:] @ centred[: len(centred) - lag] for lag in range(1, lags + 1)])
    correlation /= energy if energy > 0 else 1.0
    table = {
        "lag": np.arange(1, lags + 1) * residual.sampling_time,
        "correlation": correlation,
        "limit": np.full(lags, _NORMAL_975 / np.sqrt(len(whitened))),
    }
    noise = "noise of the floor's colour" if len(residual.whitening) > 1 else "white noise"
    words = {"noise": noise, "lags": lags, "chance": probability(p_value), "next": correlation[0]}
    sentence = said("not_noise" if p_value < SIGNIFICANT else "noise", **words)
    return View("whiteness", 0.0, p_value, sentence, table)


def linear_view(residual: Residual) -> View:
    """How much of the residual better linear dynamics could explain.

    The residual is projected on position, velocity and relaxations of the position with eight time constants.
    """
    columns = _linear_columns(residual)
    covariance = residual.covariance(columns.T)
    p_value = chi_square_p(columns.T @ residual.values, covariance)

    def explained(values: np.ndarray) -> float:
        return float(np.sum((columns.T @ values) ** 2)) / values.size

    share = residual.share_beyond_chance(explained, float(np.trace(covariance)) / len(residual.values))
    if p_value < SIGNIFICANT:
        told = said("richer" if share > _MOSTLY else "not_richer")
        words = {"share": only(share), "chance": probability(p_value), "told": told}
        sentence = said("linear", residual=residual, **words)
    else:
        sentence = said("not_linear", chance=probability(p_value))
    return View("linear dynamics", share if p_value < SIGNIFICANT else 0.0, p_value, sentence, {})


def _linear_columns(residual: Residual) -> np.ndarray:
    """Orthonormal columns of position, velocity and relaxed positions, their means taken off; (samples, columns)."""
    stacked = linear_columns(residual, relaxation_times([residual]))
    return _orthonormal(stacked / np.maximum(np.sqrt(np.mean(stacked**2, axis=0)), 1e-300))


def relaxation_times(residuals: Sequence[Residual]) -> np.ndarray:
    """Time constants (s) that span linear dynamics on all records."""
    step = max(item.sampling_time for item in residuals)
    shortest = min(item.time[-1] - item.time[0] for item in residuals)
    return np.geomspace(2 * step, max(shortest, 20 * step) / 5, _RELAXATIONS)


def linear_columns(residual: Residual, times: np.ndarray) -> np.ndarray:
    """Position, velocity and relaxed positions (time constants in s), their means taken off; shape (samples, columns)."""
    step, position = residual.sampling_time, residual.position
    columns = [position, residual.velocity]
    for time_constant in times:
        decay = np.exp(-step / time_constant)
        columns.append(filtered([1 - decay], [1.0, -decay], position - position[0]) + position[0])
    stacked = np.column_stack(columns)
    return stacked - stacked.mean(axis=0)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, values > 1e-5 * values[0]]


def correlation_view(residual: Residual) -> View:
    """Cross-correlation of the residual with the input and with even and odd functions of it.

    Of the others is taken what is neither linear in the input nor shared with functions of the other kind: z² is
    related to z³ wherever the motion is not mirrored about zero.

    Columns ``function``, ``lag`` (s, of the input's past), ``correlation`` and ``limit`` (95 % under noise alone).
    """
    functions = {name: values - values.mean() for name, values in _functions(residual).items()}
    linear = _linear_columns(residual)
    table: dict[str, list] = {"function": [], "lag": [], "correlation": [], "limit": []}
    numbers = {}
    for name, signal in functions.items():
        if name not in LINEAR_FUNCTIONS:
            others = ODD_FUNCTIONS if name in EVEN_FUNCTIONS else EVEN_FUNCTIONS
            known = np.column_stack([linear, *(functions[other] for other in others)])
            basis = _orthonormal(known / np.maximum(np.sqrt(np.mean(known**2, axis=0)), 1e-300))
            signal = signal - basis @ (basis.T @ signal)
        lags, correlation, limit, p_value = cross_correlation(residual, signal)
        table["function"] += [name] * len(lags)
        table["lag"] += list(lags * residual.sampling_time)
        table["correlation"] += list(correlation)
        table["limit"] += [limit] * len(lags)
        numbers[f"p {name}"] = p_value
    even = min(1.0, len(EVEN_FUNCTIONS) * min(numbers[f"p {name}"] for name in EVEN_FUNCTIONS))
    odd = min(1.0, len(ODD_FUNCTIONS) * min(numbers[f"p {name}"] for name in ODD_FUNCTIONS))
    p_value = min(1.0, len(numbers) * min(numbers.values()))
    numbers |= {"p even": even, "p odd": odd}
    arrays = {key: np.array(column) for key, column in table.items()}
    return View(
        "correlations", 0.0, p_value, _correlation_sentence(arrays, numbers, p_value), arrays, numbers
    )


def _functions(residual: Residual) -> dict[str, np.ndarray]:
    position, velocity = residual.position - residual.position.mean(), residual.velocity
    speed = np.std(velocity)
    return {
        "z": position,
        "v": velocity,
        "z²": position**2,
        "|v|": np.abs(velocity),
        "z³": position**3,
        "sign v": np.tanh(velocity / (0.1 * speed)) if speed > 0 else velocity,
        "v|v|": velocity * np.abs(velocity),
    }


def cross_correlation(residual: Residual, signal: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Correlation of the residual with the past of a signal.

    Lags run circularly: under the null hypothesis the wrapped signal is as unrelated as the signal.

    Returned are lags in samples, coefficients from −1 to 1, the 95 % limit of each under noise alone, and the p-value
    of all lags together.
    """
    size = len(signal)
    longest = int(min(np.sqrt(size), size // 10))
    lags = np.unique(np.linspace(0, longest, min(_LAGS, longest + 1)).astype(int))
    transform = np.fft.rfft(signal)
    covariance = np.fft.irfft(np.fft.rfft(residual.values) * transform.conj(), size)[lags]
    power = residual.noise_power(np.fft.rfftfreq(size, residual.sampling_time))
    of_noise = np.fft.irfft(power * np.abs(transform) ** 2, size)
    together = of_noise[np.abs(lags[:, None] - lags[None, :])]
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    if scale == 0:
        return lags, np.zeros(len(lags)), 0.0, 1.0
    limit = float(_NORMAL_975 * np.sqrt(of_noise[0]) / scale)
    return lags, covariance / scale, limit, chi_square_p(covariance, together, 1e-3)


def _correlation_sentence(table: dict[str, np.ndarray], numbers: dict, p_value: float) -> str:
    if p_value >= SIGNIFICANT:
        return said("not_related", chance=probability(p_value))
    found = []
    for kind, names in (("linear", LINEAR_FUNCTIONS), ("even", EVEN_FUNCTIONS), ("odd", ODD_FUNCTIONS)):
        if min(1.0, len(names) * min(numbers[f"p {name}"] for name in names)) < SIGNIFICANT:
            mine = np.isin(table["function"], names)
            top = int(np.argmax(np.abs(table["correlation"][mine])))
            found.append((table["correlation"][mine][top], table["function"][mine][top], kind))
    found.sort(key=lambda item: -abs(item[0]))
    weak = _WEAK * abs(found[0][0])
    strong, faint = (
        ", ".join(
            said(f"{kind}_{how}", value=value, name=name)
            for value, name, kind in found
            if (abs(value) > weak) == (how == "strongly")
        )
        for how in ("strongly", "weakly")
    )
    also = said("weakly", faint=faint) if faint else ""
    return said("related", strong=strong, also=also, limit=np.median(table["limit"]))


_SHARES = np.linspace(0, 1, 9)
"""Ends of the bins of the way since a reversal, as shares of the samples: most ways are short."""
_MOST, _WORTH = 0.5, 0.05
"""Shares of what linear dynamics leave and of the explainable error that another cause takes where it explains more."""
_LEAST = 0.01
"""Share of the explainable error below which a cause is not told."""
_SMALLEST = 1e-10
"""Eigenvalue of the columns' products, as a share of the largest, below which a direction is rounding."""


@dataclass(frozen=True)
class Cause:
    """What one cause accounts for."""

    name: str
    """Of the view that shows it."""
    share: float
    """Of the explainable error: linear dynamics by themselves, velocity beyond position, others beyond linear dynamics."""
    share_of_rest: float
    """Of what linear dynamics leave; of linear dynamics, the share itself."""


def rank_causes(residuals: Sequence[Residual]) -> list[Cause]:
    """Return the causes by how well they are told from the others, the best first.

    That is by share; linear dynamics come after a cause that takes most of what they leave.

    Parameters
    ----------
    residuals : sequence of Residual
        One model's, of all records.
    """
    values = np.concatenate([item.values for item in residuals])
    noise = np.mean([0.0 if item.floor is None else item.floor.rms**2 for item in residuals])
    explainable = float(np.mean(values**2)) - noise
    if explainable <= 0:
        return []
    linear = _linear(residuals)

    def left(groups: np.ndarray | None = None) -> float:
        return max(_mean_square_left(values, linear, groups) - noise, 0.0) / explainable

    rest, left_by = left(), {name: left(groups) for name, groups in _groups(residuals).items()}
    shares = {
        "linear dynamics": 1 - rest,
        "depth": rest - left_by["depth"],
        "position and velocity": left_by["depth"] - left_by["position and velocity"],
        "reversals": rest - left_by["reversals"],
        "time": _time_share(residuals, rest - left_by["time"]),
    }
    causes = [
        Cause(name, share, share if name == "linear dynamics" else share / max(rest, share))
        for name, share in shares.items()
        if share > 0
    ]
    others = [item for item in causes if item.name != "linear dynamics"]
    beaten = any(item.share > _WORTH and item.share_of_rest > _MOST for item in others)
    return sorted(causes, key=lambda item: (beaten and item.name == "linear dynamics", -item.share))


def _linear(residuals: Sequence[Residual]) -> np.ndarray:
    """A constant of each record, and linear dynamics that all have in common; shape (samples, columns)."""
    times = relaxation_times(residuals)
    common = np.vstack([linear_columns(item, times) for item in residuals])
    record = np.repeat(np.arange(len(residuals)), [len(item.values) for item in residuals])
    return np.hstack([common, record[:, None] == np.arange(len(residuals))])


def _groups(residuals: Sequence[Residual]) -> dict[str, np.ndarray]:
    """Groups of samples in each of which a cause has a level of its own, alike on all records but for windows of time."""
    position = np.concatenate([item.position for item in residuals])
    velocity = np.concatenate([item.velocity for item in residuals])
    along, across = map_edges(position, velocity)
    windows = [
        binned(np.arange(len(item.values)), [*time_edges(item), len(item.values)]) for item in residuals
    ]
    return {
        "depth": binned(position, spread_edges(position, DEPTHS)),
        "position and velocity": binned(velocity, across) * len(along) + binned(position, along),
        "reversals": _since_reversals(residuals),
        "time": np.concatenate([number * len(position) + window for number, window in enumerate(windows)]),
    }


def _since_reversals(residuals: Sequence[Residual]) -> np.ndarray:
    """Groups by the way since the last reversal, signed by its direction; 0 before the first."""
    ways = np.concatenate([_signed_way(item.position) for item in residuals])
    edges = np.unique(np.quantile(np.abs(ways[ways != 0]), _SHARES)) if np.any(ways) else np.zeros(2)
    return np.sign(ways) * (1 + binned(np.abs(ways), edges))


def _signed_way(position: np.ndarray) -> np.ndarray:
    """Way since the last reversal."""
    turns, _ = reversals(position)
    last = np.searchsorted(turns, np.arange(len(position)), side="right") - 1
    return (
        np.where(last >= 0, position - position[turns[last]], 0.0) if turns.size else np.zeros(len(position))
    )


def _mean_square_left(values: np.ndarray, linear: np.ndarray, groups: np.ndarray | None = None) -> float:
    """Mean square that a least-squares fit of columns, and of a level in each group, leaves, for its degrees of freedom."""
    products, sums = linear.T @ linear, linear.T @ values
    if groups is not None:
        number = np.unique(groups, return_inverse=True)[1]
        across = np.array([np.bincount(number, column) for column in linear.T])
        products = np.block([[products, across], [across.T, np.diag(np.bincount(number))]])
        sums = np.concatenate([sums, np.bincount(number, values)])
    size = np.sqrt(np.maximum(np.diag(products), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(products / np.outer(size, size))
    kept = eigenvalues > _SMALLEST * eigenvalues[-1]
    found = (vectors[:, kept].T @ (sums / size)) ** 2 / eigenvalues[kept]
    return float(values @ values - found.sum()) / (len(values) - int(kept.sum()))


def _time_share(residuals: Sequence[Residual], of_windows: float) -> float:
    """Share that does not repeat with the input, of records that do; of others what windows of time take."""
    repeating = [item for item in residuals if item.folding is not None]
    total = sum(item.explainable for item in repeating)
    if total <= 0:
        return of_windows
    return sum(time_view(item).share * item.explainable for item in repeating) / total


def causes_sentence(causes: Sequence[Cause], where: str, of: str) -> str:
    """Say which cause is told best from the others, with its share `of` the error, and what the next ones take."""
    told = [item for item in causes if item.share >= _LEAST]
    if not told:
        return f"{where}: no cause that was tried accounts for the error."
    first, *others = told
    beside = f", {percent(first.share_of_rest)} of what linear dynamics leave"
    beside = "" if first.name in ("linear dynamics", "time") else beside
    sentence = f"{where}: {first.name} first ({percent(first.share)} of the {of}{beside}): {said(f'{first.name} means')}"
    if first.name == "linear dynamics" and 1 - first.share > _WORTH:
        sentence += f", though {percent(1 - first.share)} of it is not linear in the motion"
    listed = ", ".join(f"{item.name} ({percent(item.share)})" for item in others)
    resembled = "; any force that follows the motion looks linear in part"
    resembled = resembled if any(item.name == "linear dynamics" for item in others) else ""
    return f"{sentence}; then {listed}{resembled}." if listed else f"{sentence}."
