"""Where in the motion a model fails: over position and velocity, over depth, around reversals, from cycle to cycle."""

import numpy as np
import scipy

from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Residual,
    View,
    only,
    percent,
    probability,
    said,
)

DEPTHS = 20
_POSITIONS, _SPEEDS = 12, 5
_FEWEST_SAMPLES = 5
SIGNIFICANT_Z = 3.0
"""Standard deviations from which on the mean of a single cell of the map stands out of the noise."""
_MOSTLY = 0.8
_LEAST_TURN = 0.03
"""A reversal counts if the motion since the last one exceeds this share of the position's range."""
_MIRRORED = 0.6
"""Share of the map's energy in bins whose mirrored bin is visited too that an even/odd split asks for."""
_FEWEST_CYCLES = 8
_RELATED = 0.3
"""Rank correlation from which on a relation is worth telling, however significant."""
_COLUMNS = ("start", "stop", "amplitude", "speed", "rms")


def depth_view(residual: Residual) -> View:
    """Mean residual against position, advancing and retracting.

    Columns ``position``, ``mean``, ``deviation`` (under noise), and ``advancing``, ``retracting`` means.
    """
    edges = spread_edges(residual.position, DEPTHS)
    count = len(edges) - 1
    groups = binned(residual.position, edges)
    number = np.bincount(groups, minlength=count)
    groups = np.where(number[groups] >= _FEWEST_SAMPLES, groups, -1)
    average = residual.averages(groups, count)
    advancing = _means(residual.values, np.where(residual.velocity > 0, groups, -1), count)
    retracting = _means(residual.values, np.where(residual.velocity < 0, groups, -1), count)
    position = _means(residual.position, groups, count)
    table = {
        "position": position,
        "mean": average.mean,
        "deviation": average.deviation,
        "advancing": advancing,
        "retracting": retracting,
    }
    words = {"residual": residual, "share": only(average.share), "chance": probability(average.p_value)}
    sentence = said("no_depth", **words)
    if average.p_value < SIGNIFICANT:
        ends = [int(np.nanargmin(average.mean)), int(np.nanargmax(average.mean))]
        shape = _shape_words(position, average.mean, average.deviation) if average.share > 0.1 else ""
        sentence = said("depth", means=average.mean[ends], places=position[ends], shape=shape, **words)
    return View("depth", average.significant_share, average.p_value, sentence, table)


def _means(values: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    inside = groups >= 0
    number = np.bincount(groups[inside], minlength=count)
    sums = np.bincount(groups[inside], values[inside], count)
    return np.where(number >= _FEWEST_SAMPLES, sums / np.maximum(number, 1), np.nan)


def _shape_words(position: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> str:
    """Which of a curve's even and odd parts about the middle of the range is the larger."""
    middle = (position[0] + position[-1]) / 2
    mirrored = np.interp(2 * middle - position, position, mean)
    even, odd = (mean + mirrored) / 2, (mean - mirrored) / 2
    noise = np.mean(deviation**2) / 2
    even_power, odd_power = np.mean(even**2) - noise, np.mean(odd**2) - noise
    if even_power > 2 * odd_power:
        return ", alike at both ends (even in position)"
    if odd_power > 2 * even_power:
        return ", opposite at both ends (odd in position)"
    return ", different at the two ends"


def map_view(residual: Residual) -> View:
    """Mean residual over position and velocity, by direction.

    Columns ``position_low``, ``position_high``, ``velocity_low``, ``velocity_high``, ``mean``, ``z_score`` (mean over
    its deviation under noise) and ``count``; bins with fewer than five samples hold NaN.
    """
    position_edges, velocity_edges = map_edges(residual.position, residual.velocity)
    columns, rows = len(position_edges) - 1, len(velocity_edges) - 1
    cell = binned(residual.velocity, velocity_edges) * columns + binned(residual.position, position_edges)
    number = np.bincount(cell, minlength=rows * columns)
    groups = np.where(number[cell] >= _FEWEST_SAMPLES, cell, -1)
    average = residual.averages(groups, rows * columns)
    low_row, low_column = np.divmod(np.arange(rows * columns), columns)
    table = {
        "position_low": position_edges[low_column],
        "position_high": position_edges[low_column + 1],
        "velocity_low": velocity_edges[low_row],
        "velocity_high": velocity_edges[low_row + 1],
        "mean": average.mean,
        "z_score": average.mean / average.deviation,
        "count": average.count,
    }
    even, odd = _even_odd(residual, average, rows, columns, position_edges, velocity_edges)
    numbers = {"even_share": even, "odd_share": odd}
    words = {"residual": residual, "share": only(average.share), "chance": probability(average.p_value)}
    sentence = said("no_map", **words)
    if average.p_value < SIGNIFICANT:
        parity = "" if even is None else said("parity", odd=percent(odd), even=percent(even))
        if not np.any(np.abs(table["z_score"]) >= SIGNIFICANT_Z):
            parity += ", as a pattern: no single cell stands out of the noise"
        rest = "little is left for" if average.share > _MOSTLY else "the rest needs"
        sentence = said("map", parity=parity, largest=_largest(residual, table), rest=rest, **words)
    return View("position and velocity", average.significant_share, average.p_value, sentence, table, numbers)


def map_edges(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the map's cells along position and along velocity."""
    return _symmetric_edges(position, _POSITIONS // 2), _symmetric_edges(velocity, _SPEEDS)


def binned(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of the bin of each value; what lies beyond the edges is in the outer bins."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def _largest(residual: Residual, table: dict[str, np.ndarray]) -> str:
    """Where on the map the mean error is largest, in words."""
    cell = int(np.nanargmax(np.abs(table["mean"])))
    slow, fast = sorted(abs(table[name][cell]) for name in ("velocity_low", "velocity_high"))
    at = {name: values[cell] for name, values in table.items()}
    way = "advancing" if at["velocity_high"] > 0 else "retracting"
    return said("largest", residual=residual, at=at, way=way, slow=slow, fast=fast)


def spread_edges(values: np.ndarray, count: int) -> np.ndarray:
    """Edges halfway between those of equally wide and of equally filled bins: fine where the motion mostly is, and not
    coarse at its ends, where errors are largest.
    """
    filled = np.quantile(values, np.linspace(0, 1, count + 1))
    return np.unique((filled + np.linspace(filled[0], filled[-1], count + 1)) / 2)


def _symmetric_edges(values: np.ndarray, half: int) -> np.ndarray:
    """Edges of bins that mirror each other about zero where the values do."""
    if min(np.mean(values > 0), np.mean(values < 0)) < 0.25:
        return spread_edges(values, 2 * half)
    edges = spread_edges(np.append(np.abs(values), 0.0), half)[1:]
    return np.unique(np.concatenate([-edges[::-1], [0.0], edges]))


def _even_odd(residual, average, rows, columns, *edges) -> tuple[float | None, float | None]:
    """Shares of the map that keep and that change their sign when position and velocity change theirs."""
    if not all(np.allclose(edge, -edge[::-1]) for edge in edges):
        return None, None
    mean = average.mean.reshape(rows, columns)
    mirrored = mean[::-1, ::-1]
    weight = average.count.reshape(rows, columns) / len(residual.values)
    both = np.isfinite(mean) & np.isfinite(mirrored)
    energy = weight * np.nan_to_num(mean) ** 2
    if energy[both].sum() < _MIRRORED * energy.sum():
        return None, None
    variance = average.deviation.reshape(rows, columns) ** 2
    noise = (variance + variance[::-1, ::-1])[both] / 4
    even, odd = ((mean + mirrored) / 2)[both], ((mean - mirrored) / 2)[both]
    return tuple(residual.share(float(weight[both] @ (part**2 - noise))) for part in (even, odd))


def reversals(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples at which the motion turns, and the direction (±1) it takes then.

    A turn counts when the motion back from the extreme exceeds a share of the range: noise in a measured position
    turns often but not far.
    """
    least = float(_LEAST_TURN * np.ptp(position))
    values = np.asarray(position, dtype=float).tolist()  # plain numbers: the loop takes half the time
    turns, directions = [], []
    direction, extreme = 0, 0
    for sample, value in enumerate(values):
        if (direction >= 0 and value > values[extreme]) or (direction <= 0 and value < values[extreme]):
            extreme = sample
        if direction == 0:
            if abs(value - values[0]) > least:
                direction, extreme = int(np.sign(value - values[0])), sample
        elif direction * (values[extreme] - value) > least:
            turns.append(extreme)
            direction = -direction
            directions.append(direction)
            extreme = sample
    return np.array(turns, dtype=int), np.array(directions, dtype=int)


def reversal_reach(turns: np.ndarray, size: int) -> int:
    """How many of `size` samples before and after a reversal count as around it; 0 with fewer than two reversals."""
    gaps = np.diff(turns)
    return int(np.clip(0.5 * np.median(gaps), 2, size // 8)) if gaps.size else 0


def reversal_view(residual: Residual) -> View:
    """Mean residual around reversals, signed by the direction taken after them.

    Columns ``time`` (s after the reversal), ``mean`` and ``deviation`` under noise, of direction times residual.
    """
    turns, directions = reversals(residual.position)
    half = reversal_reach(turns, len(residual.values))
    inside = (turns >= half) & (turns < len(residual.values) - half) if half else np.zeros(0, dtype=bool)
    turns, directions = (turns[inside], directions[inside]) if half else (turns[:0], directions[:0])
    if turns.size < 4:
        empty = {name: np.zeros(0) for name in ("time", "mean", "deviation")}
        return View("reversals", 0.0, 1.0, said("few_reversals", number=turns.size), empty)
    stride = max(1, half // 20)
    offsets = np.arange(-half, half + 1, stride)
    weights = np.zeros((len(offsets), len(residual.values)))
    for row, offset in enumerate(offsets):
        np.add.at(weights[row], turns + offset, directions / turns.size)
    mean = weights @ residual.values
    covariance = residual.covariance(weights)
    table = {
        "time": offsets * residual.sampling_time,
        "mean": mean,
        "deviation": np.sqrt(np.diag(covariance)),
    }
    contrast = np.where(offsets > 0, 1.0, np.where(offsets < 0, -1.0, 0.0)) / np.sum(offsets > 0)
    change, deviation = float(contrast @ mean), float(np.sqrt(contrast @ covariance @ contrast))
    average = _since_reversal(residual, turns, directions)
    words = {"number": turns.size, "share": only(average.share), "chance": probability(average.p_value)}
    sentence = said("no_reversals", **words)
    opposed = change > max(3 * deviation, 0.5 * np.sqrt(residual.explainable))
    if average.p_value < SIGNIFICANT:
        words |= {"change": change, "twice": 2 * deviation, "reach": half * residual.sampling_time}
        meaning = said("opposed") if opposed else ""
        sentence = said("reversals", residual=residual, meaning=meaning, **words)
    numbers = {"reversals": int(turns.size), "change": change, "change_deviation": deviation}
    numbers["opposed"] = bool(opposed and average.p_value < SIGNIFICANT)
    return View("reversals", average.significant_share, average.p_value, sentence, table, numbers)


def _since_reversal(residual: Residual, turns: np.ndarray, directions: np.ndarray):
    """Means over the time since the last reversal, in eight equally filled bins, by direction."""
    samples = np.arange(len(residual.values))
    last = np.searchsorted(turns, samples, side="right") - 1
    since = samples - turns[np.maximum(last, 0)]
    known = last >= 0
    edges = np.unique(np.quantile(since[known], np.linspace(0, 1, 9)[1:-1]))
    bin_number = np.searchsorted(edges, since, side="right")
    upward = directions[np.maximum(last, 0)] > 0
    groups = np.where(known, bin_number + (len(edges) + 1) * upward, -1)
    return residual.averages(groups, 2 * (len(edges) + 1))


def cycle_view(residual: Residual) -> View:
    """RMS of the residual in every cycle of the motion, from one lower turning point to the next.

    Columns ``start``, ``stop`` (s), ``amplitude`` (half the stroke), ``speed`` (largest) and ``rms``.
    """
    turns, directions = reversals(residual.position)
    bounds = turns[directions > 0]
    if len(bounds) <= _FEWEST_CYCLES:
        words = f"Over cycles: the motion has {max(len(bounds) - 1, 0)}, too few to compare."
        return View("cycles", 0.0, 1.0, words, {name: np.zeros(0) for name in _COLUMNS})
    table = _cycles(residual, bounds)
    rms, unit = table["rms"], residual.unit
    with_amplitude, amplitude_p = rank_correlation(table["amplitude"], rms)
    with_speed, speed_p = rank_correlation(table["speed"], rms)
    p_value = min(1.0, 2 * min(amplitude_p, speed_p))  # Bonferroni
    low, high = np.quantile(rms, [0.1, 0.9])
    spread = f"in eight of ten of the motion's {len(rms)} cycles the error's RMS lies from {low:.3g} to {high:.3g} {unit}"
    numbers = {"cycles": len(rms), "rank_with_amplitude": with_amplitude, "rank_with_speed": with_speed}
    related = [
        f"{'grows' if rank > 0 else 'falls'} with their {name} (rank correlation {rank:+.2f}, {probability(p)})"
        for name, rank, p in (("amplitude", with_amplitude, amplitude_p), ("speed", with_speed, speed_p))
        if 2 * p < SIGNIFICANT and abs(rank) > _RELATED
    ]
    told = f"it {' and '.join(related)}" if related else "it hardly depends on their amplitude or speed"
    return View("cycles", 0.0, p_value, f"Over cycles: {spread}; {told}.", table, numbers)


def _cycles(residual: Residual, bounds: np.ndarray) -> dict[str, np.ndarray]:
    """What `cycle_view` tabulates; `bounds` are the samples of the lower turning points."""
    inside = slice(bounds[0], bounds[-1])
    starts, lengths = bounds[:-1] - bounds[0], np.diff(bounds)
    position, speed = residual.position[inside], np.abs(residual.velocity[inside])
    stroke = np.maximum.reduceat(position, starts) - np.minimum.reduceat(position, starts)
    return {
        "start": residual.time[bounds[:-1]],
        "stop": residual.time[bounds[1:]],
        "amplitude": stroke / 2,
        "speed": np.maximum.reduceat(speed, starts),
        "rms": np.sqrt(np.add.reduceat(residual.values[inside] ** 2, starts) / lengths),
    }


def rank_correlation(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """Spearman's rank correlation and its two-sided p-value by Student's t; for values without ties.

    C. Spearman, Am. J. Psychol. 15 (1904) 72-101.
    """
    ranks = [np.argsort(np.argsort(values)) for values in (first, second)]
    correlation = float(np.corrcoef(*ranks)[0, 1])
    degrees = len(first) - 2
    size = abs(correlation) * np.sqrt(degrees / max(1 - correlation**2, 1e-300))
    return correlation, float(2 * scipy.special.stdtr(degrees, -size))
