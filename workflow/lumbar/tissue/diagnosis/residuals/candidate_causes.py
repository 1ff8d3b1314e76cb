"""Candidate causes of a simulation's residual: correlations with the input, and a ranking of the causes.

A residual that is related to the input contains dynamics or nonlinearity that a better model would explain (Ljung,
System Identification, 2nd ed., section 16.6). Even functions of the input, z² and |v|, reveal a force that is not mirrored if the
motion is mirrored; the input itself does not (Billings and Voon, Int. J. Control 44, 1986). Limits are computed from the spectra
of noise and function, so they are valid for coloured noise too.

On one record any force that depends on the motion resembles linear dynamics, its best linear approximation, which differs between
excitations (Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 3). A refitted base also
leaves a linear part, for any missing effect. So the same linear dynamics are fitted to the error of all records, and every other
cause is fitted together with them: its share of the rest distinguishes it from linear dynamics.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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
    format_share,
    percent,
    probability,
)
from lumbar.tissue.diagnosis.residuals.time_frequency import time_edges, time_view
from lumbar.tissue.models.transfer_function import filtered

_NORMAL_975 = 1.959964
_LAGS = 25
_RELAXATIONS = 8
"""Number of time constants, spread evenly in logarithm, that span linear dynamics."""
_MOST_OF_ERROR = 0.8
_WEAK_RATIO = 0.3
"""Share of the largest correlation below which a correlation is called weak, even if it is significant."""
LINEAR_FUNCTIONS = ("z", "v")
EVEN_FUNCTIONS = ("z²", "|v|")
ODD_FUNCTIONS = ("z³", "sign v", "v|v|")
_KINDS = {
    "position and velocity": (LINEAR_FUNCTIONS, "; linear dynamics"),
    "even functions": (
        EVEN_FUNCTIONS,
        "; an even nonlinearity: a force that is not mirrored with the motion",
    ),
    "odd functions": (ODD_FUNCTIONS, "; an odd nonlinearity: a force that is mirrored with the motion"),
}
"""Functions of the input and their meaning, by kind."""
_CAUSES = {
    "time": "it does not repeat with the motion, as a drift, a softening or a disturbance",
    "position and velocity": "a damping or friction that depends on the present velocity",
    "depth": "a stiffness that depends on depth, a contact or a limit of the force",
    "reversals": "a memory of the last reversal, as hysteresis or play",
    "linear dynamics": "linear dynamics that the model lacks, as inertia, delay or another relaxation",
    "constant offset": "a zero of the sensor or a mean force that the model lacks",
}
"""Physical meaning of every cause that `rank_causes` compares."""
CAUSE_EFFECTS = {
    "time": ("softening", "drift", "periodic_disturbance", "hand_load", "variable_length", "moving_pivot"),
    "position and velocity": (
        *("coulomb_friction", "viscous_damping", "quadratic_damping", "depth_dependent_damping", "drag"),
        *("hand_load", "variable_length", "moving_pivot", "contact_loss", "saturation"),
    ),
    "depth": (
        *("hardening_stiffness", "quadratic_stiffness", "strain_softening", "contact_loss", "saturation"),
        *("passive_stiffness", "absolute_value"),
    ),
    "reversals": ("hysteresis", "coulomb_friction", "backlash"),
    "linear dynamics": ("inertia", "delay", "second_relaxation", "relaxation_spectrum", "viscous_damping"),
}
"""Effects that leave an error of each cause if a model lacks them, by name; a constant offset has none."""


def causes_view(residual: Residual) -> View:
    """Return the correlation of the residual with functions of the input, and the share that linear dynamics would explain.

    Even and odd functions count only with the part that is neither linear in the input nor shared with functions of the other
    kind: z² is related to z³ unless the motion is mirrored about zero. Linear dynamics are position, velocity and relaxations of
    the position with eight time constants.

    The numbers of the view are ``p even``, ``p odd``, ``linear_share`` (beyond chance, 0 unless significant) and ``linear_p``.
    Its p-value is the p-value of the correlations.
    """
    linear = _orthonormal(linear_columns(residual, relaxation_times([residual])))
    covariance = residual.covariance(linear.T)
    linear_p = chi_square_p(linear.T @ residual.values, covariance)

    def explained(values: np.ndarray) -> float:
        return float(np.sum((linear.T @ values) ** 2)) / values.size

    share = residual.share_beyond_chance(explained, float(np.trace(covariance)) / len(residual.values))
    linear_sentence = f"the error is not related to the input linearly ({probability(linear_p)})"
    if linear_p < SIGNIFICANT:
        rest = (
            "a richer linear model is worth trying"
            if share > _MOST_OF_ERROR
            else "the rest is not linear in the input"
        )
        linear_sentence = (
            "stiffness, damping and relaxations fitted to the error itself (linear dynamics) would explain "
            f"{format_share(share)} of the {residual.error_name} of this record ({probability(linear_p)}); {rest}"
        )
    position, velocity = residual.position - residual.position.mean(), residual.velocity
    speed = np.std(velocity)
    functions = {
        "z": position,
        "v": velocity,
        "z²": position**2,
        "|v|": np.abs(velocity),
        "z³": position**3,
        "sign v": np.tanh(velocity / (0.1 * speed)) if speed > 0 else velocity,
        "v|v|": velocity * np.abs(velocity),
    }
    functions = {name: values - values.mean() for name, values in functions.items()}
    correlations = {}
    for name, signal in functions.items():
        if name not in LINEAR_FUNCTIONS:
            others = ODD_FUNCTIONS if name in EVEN_FUNCTIONS else EVEN_FUNCTIONS
            basis = _orthonormal(np.column_stack([linear, *(functions[other] for other in others)]))
            signal = signal - basis @ (basis.T @ signal)
        correlations[name] = cross_correlation(residual, signal)
    p_value = _smallest_p(correlations, correlations)
    numbers = {
        "linear_share": share if linear_p < SIGNIFICANT else 0.0,
        "linear_p": linear_p,
        "p even": _smallest_p(correlations, EVEN_FUNCTIONS),
        "p odd": _smallest_p(correlations, ODD_FUNCTIONS),
    }
    sentence = f"Candidate causes: {linear_sentence}. {_correlation_sentence(correlations, p_value)}"
    return View("candidate causes", None, p_value, sentence, numbers=numbers)


def _smallest_p(correlations: Mapping[str, CrossCorrelation], names: Collection[str]) -> float:
    """Return the probability that the smallest p-value of the named correlations is due to chance (Bonferroni)."""
    return min(1.0, len(names) * min(correlations[name].p_value for name in names))


def relaxation_times(residuals: Sequence[Residual]) -> np.ndarray:
    """Return time constants (s) that span linear dynamics on all records."""
    step = max(item.sampling_time for item in residuals)
    shortest = min(item.time[-1] - item.time[0] for item in residuals)
    return np.geomspace(2 * step, max(shortest, 20 * step) / 5, _RELAXATIONS)


def linear_columns(residual: Residual, times: np.ndarray) -> np.ndarray:
    """Return position, velocity and relaxed positions (time constants in s) about their means; shape (samples, columns)."""
    step, position = residual.sampling_time, residual.position
    columns = [position, residual.velocity]
    for time_constant in times:
        decay = np.exp(-step / time_constant)
        columns.append(filtered([1 - decay], [1.0, -decay], position - position[0]) + position[0])
    stacked = np.column_stack(columns)
    return stacked - stacked.mean(axis=0)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of columns, which are first scaled to equal size."""
    scaled = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    left, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return left[:, values > 1e-5 * values[0]]


@dataclass(frozen=True, eq=False)
class CrossCorrelation:
    """Correlation of a residual with the past of a signal."""

    lags: np.ndarray
    """Lags in samples, shape (lags,)."""
    values: np.ndarray
    """Correlation coefficients from −1 to 1, shape (lags,)."""
    limit: float
    """95 % limit of each coefficient under noise only."""
    p_value: float
    """Probability that noise only gives such large coefficients, for all lags together."""


def cross_correlation(residual: Residual, signal: np.ndarray) -> CrossCorrelation:
    """Correlate the residual with the past of a signal, which is periodic: under the null hypothesis any shift is unrelated."""
    size = len(signal)
    longest = int(min(np.sqrt(size), size // 10))
    lags = np.unique(np.linspace(0, longest, min(_LAGS, longest + 1)).astype(int))
    scale = np.sqrt(np.sum(residual.values**2) * np.sum(signal**2))
    if scale == 0:
        return CrossCorrelation(lags, np.zeros(len(lags)), 0.0, 1.0)
    transform = np.fft.rfft(signal)
    covariance = np.fft.irfft(np.fft.rfft(residual.values) * transform.conj(), size)[lags]
    # Covariance of these sums under noise alone, by the spectra of noise and signal.
    power = residual.noise_power(np.fft.rfftfreq(size, residual.sampling_time))
    of_noise = np.fft.irfft(power * np.abs(transform) ** 2, size)
    together = of_noise[np.abs(lags[:, None] - lags[None, :])]
    limit = float(_NORMAL_975 * np.sqrt(of_noise[0]) / scale)
    return CrossCorrelation(lags, covariance / scale, limit, chi_square_p(covariance, together, 1e-3))


def _correlation_sentence(correlations: Mapping[str, CrossCorrelation], p_value: float) -> str:
    if p_value >= SIGNIFICANT:
        return f"No correlation with a function of the input is significant ({probability(p_value)})."
    # The largest correlation of every kind of function that is significant.
    largest = []
    for kind, (names, meaning) in _KINDS.items():
        if _smallest_p(correlations, names) < SIGNIFICANT:
            values = {name: max(correlations[name].values, key=abs) for name in names}
            name = max(names, key=lambda item: abs(values[item]))
            largest.append((values[name], name, kind, meaning))
    largest.sort(key=lambda item: -abs(item[0]))
    strong, faint = [], []
    for value, name, kind, meaning in largest:
        if abs(value) > _WEAK_RATIO * abs(largest[0][0]):
            strong.append(f"{kind} (up to {value:+.2f} with {name}{meaning})")
        else:
            faint.append(f"{kind} ({value:+.2f} with {name})")
    weakly = f"; weakly also with {', '.join(faint)}" if faint else ""
    limit = np.median([item.limit for item in correlations.values()])
    return f"The error correlates with {', '.join(strong)}{weakly}; noise alone stays below {limit:.2g}."


_PATH_SHARES = np.linspace(0, 1, 9)
"""Ends of the bins of the path since a reversal, as shares of the samples, because most paths are short."""
_MAJOR_SHARE_OF_REST, _MAJOR_SHARE = 0.5, 0.05
"""Share of the error left by linear dynamics, and share of the explainable error, above which a cause comes before them."""
_MIN_SHARE = 0.01
"""Share of the explainable error below which a cause is not reported."""
_FITTED_FIRST = ("constant offset", "linear dynamics")
"""Causes that are fitted first; all other causes share the error that these leave."""
_MIN_EIGENVALUE = 1e-10
"""Eigenvalue of the Gram matrix of the columns, as a share of the largest, below which a direction is rounding."""


@dataclass(frozen=True)
class Cause:
    """A cause with its share of the error of all records."""

    name: str
    """Name of the cause, a key of `_CAUSES`."""
    share: float
    """Share of the explainable error: for velocity in addition to position, for other causes in addition to linear dynamics."""
    share_of_rest: float
    """Share of the error left by linear dynamics; equal to `share` for causes that are fitted first."""

    @property
    def is_notable(self) -> bool:
        """True if the share is large enough to report."""
        return self.share >= _MIN_SHARE

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that leave such an error, in any catalogue, the most common first."""
        return CAUSE_EFFECTS.get(self.name, ())


def rank_causes(residuals: Sequence[Residual]) -> list[Cause]:
    """Return the causes in the order of their shares, the largest first.

    A constant offset comes after other large causes, linear dynamics after a cause of most of the error that they leave.

    Parameters
    ----------
    residuals : sequence of Residual
        Residuals of one model on all records.

    Returns
    -------
    list of Cause
    """
    values = np.concatenate([item.values for item in residuals])
    noise = np.mean([0.0 if item.floor is None else item.floor.rms**2 for item in residuals])
    explainable = float(np.mean(values**2)) - noise
    if explainable <= 0:
        return []
    # Linear dynamics that all records have in common, then a constant of each record; shape (samples, columns).
    times = relaxation_times(residuals)
    record = np.repeat(np.arange(len(residuals)), [len(item.values) for item in residuals])
    constants = record[:, None] == np.arange(len(residuals))
    linear = np.hstack([np.vstack([linear_columns(item, times) for item in residuals]), constants])

    def error_left(columns: np.ndarray = linear, groups: np.ndarray | None = None) -> float:
        return max(_mean_square_left(values, columns, groups) - noise, 0.0) / explainable

    rest, left_by = (
        error_left(),
        {name: error_left(groups=groups) for name, groups in _groups(residuals).items()},
    )
    # Of records that repeat, time has what does not repeat with the input; of others, what windows of time explain.
    by_time, repeating = rest - left_by["time"], [item for item in residuals if item.folding is not None]
    if (total := sum(item.explainable for item in repeating)) > 0:
        by_time = sum(time_view(item).share * item.explainable for item in repeating) / total
    # The last columns are the records' constants: an offset is not linear dynamics.
    centred = error_left(linear[:, -len(residuals) :])
    shares = {
        "constant offset": 1 - centred,
        "linear dynamics": centred - rest,
        "depth": rest - left_by["depth"],
        "position and velocity": left_by["depth"] - left_by["position and velocity"],
        "reversals": rest - left_by["reversals"],
        "time": by_time,
    }
    causes = [
        Cause(name, share, share if name in _FITTED_FIRST else share / max(rest, share))
        for name, share in shares.items()
        if share > 0
    ]
    # A constant comes last if anything else is worth naming, linear dynamics after a cause that takes most of what they leave.
    is_known = any(item.share > _MAJOR_SHARE for item in causes if item.name != "constant offset")
    others = [item for item in causes if item.name not in _FITTED_FIRST and item.share > _MAJOR_SHARE]
    is_beaten = any(item.share_of_rest > _MAJOR_SHARE_OF_REST for item in others)
    last = {"constant offset": is_known, "linear dynamics": is_beaten}
    return sorted(causes, key=lambda item: (last.get(item.name, False), -item.share))


def _groups(residuals: Sequence[Residual]) -> dict[str, np.ndarray]:
    """Return groups of samples by cause; a cause has one level per group. Records share all groups except windows of time."""
    position = np.concatenate([item.position for item in residuals])
    velocity = np.concatenate([item.velocity for item in residuals])
    along, across = map_edges(position, velocity)
    windows, paths = [], []
    for number, item in enumerate(residuals):
        samples = np.arange(len(item.values))
        window = binned(samples, [*time_edges(item), len(samples)])
        windows.append(number * len(position) + window)
        # Path since the last reversal, signed by its direction; 0 before the first.
        turns, _ = reversals(item.position)
        path = np.zeros(len(samples))
        if turns.size:
            last = np.searchsorted(turns, samples, side="right") - 1
            path = np.where(last >= 0, item.position - item.position[turns[last]], 0.0)
        paths.append(path)
    path = np.concatenate(paths)
    edges = np.unique(np.quantile(np.abs(path[path != 0]), _PATH_SHARES)) if np.any(path) else np.zeros(2)
    return {
        "depth": binned(position, spread_edges(position, DEPTHS)),
        "position and velocity": binned(velocity, across) * len(along) + binned(position, along),
        "reversals": np.sign(path) * (1 + binned(np.abs(path), edges)),
        "time": np.concatenate(windows),
    }


def _mean_square_left(values: np.ndarray, linear: np.ndarray, groups: np.ndarray | None = None) -> float:
    """Return the mean square per degree of freedom left by a least-squares fit of columns and of a level in each group."""
    products, sums = linear.T @ linear, linear.T @ values
    if groups is not None:
        number = np.unique(groups, return_inverse=True)[1]
        across = np.array([np.bincount(number, column) for column in linear.T])
        products = np.block([[products, across], [across.T, np.diag(np.bincount(number))]])
        sums = np.concatenate([sums, np.bincount(number, values)])
    size = np.sqrt(np.maximum(np.diag(products), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(products / np.outer(size, size))
    used = eigenvalues > _MIN_EIGENVALUE * eigenvalues[-1]
    explained = (vectors[:, used].T @ (sums / size)) ** 2 / eigenvalues[used]
    return float(values @ values - explained.sum()) / (len(values) - int(used.sum()))


def causes_sentence(causes: Sequence[Cause], where: str, error: str) -> str:
    """Name the first cause, with its share of the `error`, and the next causes with their shares."""
    notable = [item for item in causes if item.is_notable]
    if not notable:
        return f"{where}: no cause that was tried accounts for the error."
    first, *others = notable
    of_rest = f", {percent(first.share_of_rest)} of what linear dynamics leave"
    of_rest = "" if first.name in (*_FITTED_FIRST, "time") else of_rest
    sentence = (
        f"{where}: {first.name} first ({percent(first.share)} of the {error}{of_rest}): {_CAUSES[first.name]}"
    )
    if first.name == "linear dynamics" and 1 - first.share > _MAJOR_SHARE:
        sentence += f", though {percent(1 - first.share)} of it is not linear in the motion"
    if not others:
        return f"{sentence}."
    listed = ", ".join(f"{item.name} ({percent(item.share)})" for item in others)
    linear = any(item.name == "linear dynamics" for item in others)
    resembled = "; any force that follows the motion looks linear in part" if linear else ""
    return f"{sentence}; then {listed}{resembled}."
