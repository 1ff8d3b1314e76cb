"""Where in the motion a model fails: over position and velocity, and around reversals."""

import numpy as np

from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Average,
    Residual,
    View,
    only,
    percent,
    probability,
)

DEPTHS = 20
_POSITIONS, _SPEEDS = 12, 5
_FEWEST_SAMPLES = 5
SIGNIFICANT_Z = 3.0
"""Standard deviations at which the mean of a single cell of the map exceeds the noise."""
_MOSTLY = 0.8
_LEAST_TURN = 0.03
"""A reversal counts if the motion since the last one exceeds this share of the position's range."""
_MIRRORED = 0.6
"""Share of the map's energy in bins whose mirrored bin is visited too that an even/odd split asks for."""


def _means(values: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    inside = groups >= 0
    number = np.bincount(groups[inside], minlength=count)
    sums = np.bincount(groups[inside], values[inside], count)
    return np.where(number >= _FEWEST_SAMPLES, sums / np.maximum(number, 1), np.nan)


def _shape_words(position: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> str:
    """Say which of a curve's even and odd parts about the middle of the range is larger."""
    middle = (position[0] + position[-1]) / 2
    mirrored = np.interp(2 * middle - position, position, mean)
    even, odd = (mean + mirrored) / 2, (mean - mirrored) / 2
    noise = np.mean(deviation**2) / 2
    even_power, odd_power = np.mean(even**2) - noise, np.mean(odd**2) - noise
    if even_power > 2 * odd_power:
        return ", equal at both ends (even in position)"
    if odd_power > 2 * even_power:
        return ", opposite at both ends (odd in position)"
    return ", different at the two ends"


def motion_view(residual: Residual) -> View:
    """Mean residual over position and velocity, and over position by itself, advancing and retracting.

    Columns ``position``, ``mean``, ``deviation`` (under noise), and ``advancing``, ``retracting`` means. Numbers ``even_share``,
    ``odd_share`` (of the map over position and velocity), ``depth_share`` and ``depth_p`` (of position by itself). Share and
    p-value are those of the map.
    """
    # The map: cells of position and velocity with enough samples.
    position_edges, velocity_edges = map_edges(residual.position, residual.velocity)
    columns, rows = len(position_edges) - 1, len(velocity_edges) - 1
    cell = binned(residual.velocity, velocity_edges) * columns + binned(residual.position, position_edges)
    average = residual.averages(_filled(cell, rows * columns), rows * columns)
    even, odd = _even_odd(residual, average, rows, columns, position_edges, velocity_edges)
    # The same over position by itself.
    edges = spread_edges(residual.position, DEPTHS)
    groups = _filled(binned(residual.position, edges), len(edges) - 1)
    depth = residual.averages(groups, len(edges) - 1)
    table = {
        "position": _means(residual.position, groups, len(edges) - 1),
        "mean": depth.mean,
        "deviation": depth.deviation,
        "advancing": _means(residual.values, np.where(residual.velocity > 0, groups, -1), len(edges) - 1),
        "retracting": _means(residual.values, np.where(residual.velocity < 0, groups, -1), len(edges) - 1),
    }
    numbers = {
        "even_share": even,
        "odd_share": odd,
        "depth_share": depth.significant_share,
        "depth_p": depth.p_value,
    }
    both = f"Over position and velocity: the mean error depends on neither ({probability(average.p_value)})"
    if average.p_value < SIGNIFICANT:
        both = (
            f"Over position and velocity: their present values account for {only(average.share)} of the {residual.base_words} "
            f"({probability(average.p_value)})"
        )
        if even is not None:
            both += f", {percent(odd)} with a force mirrored with the motion (odd), {percent(even)} with another one (even)"
        if not np.any(np.abs(average.mean / average.deviation) >= SIGNIFICANT_Z):
            both += ", as a pattern: no single cell exceeds the noise"
        rest = "little remains for" if average.share > _MOSTLY else "the rest needs"
        largest = _largest(residual, average.mean, position_edges, velocity_edges)
        both += f"; the mean error is {largest}; {rest} history, time or faster dynamics"
    sentence = f"{both}. {_depth_sentence(residual, depth, table)}"
    return View("position and velocity", average.significant_share, average.p_value, sentence, table, numbers)


def _filled(groups: np.ndarray, count: int) -> np.ndarray:
    """The groups, with −1 for those of too few samples."""
    return np.where(np.bincount(groups, minlength=count)[groups] >= _FEWEST_SAMPLES, groups, -1)


def _depth_sentence(residual: Residual, depth: Average, table: dict[str, np.ndarray]) -> str:
    chance, unit, at = probability(depth.p_value), residual.unit, residual.position_unit
    if depth.p_value >= SIGNIFICANT:
        return f"Over depth the mean error does not change ({chance})."
    position, mean = table["position"], table["mean"]
    low, high = int(np.nanargmin(mean)), int(np.nanargmax(mean))
    shape = _shape_words(position, mean, table["deviation"]) if depth.share > 0.1 else ""
    return (
        f"Depth by itself accounts for {only(depth.share)} of the {residual.base_words} ({chance}); the mean error runs from "
        f"{mean[low]:+.3g} {unit} at {position[low]:.3g} {at} to {mean[high]:+.3g} {unit} at {position[high]:.3g} {at}{shape}."
    )


def map_edges(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the map's cells along position and along velocity."""
    return _symmetric_edges(position, _POSITIONS // 2), _symmetric_edges(velocity, _SPEEDS)


def binned(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of the bin of each value; what lies beyond the edges is in the outer bins."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def _largest(
    residual: Residual, mean: np.ndarray, position_edges: np.ndarray, velocity_edges: np.ndarray
) -> str:
    """Say where on the map the mean error is largest."""
    cell = int(np.nanargmax(np.abs(mean)))
    row, column = divmod(cell, len(position_edges) - 1)
    slow, fast = sorted(np.abs(velocity_edges[row : row + 2]))
    direction, at = "advancing" if velocity_edges[row + 1] > 0 else "retracting", residual.position_unit
    return (
        f"largest, {mean[cell]:+.3g} {residual.unit}, from {position_edges[column]:.3g} to "
        f"{position_edges[column + 1]:.3g} {at} while {direction} at {slow:.3g} to {fast:.3g} {at}/s"
    )


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
    """Return the number of samples before and after a reversal that count as around it; 0 with fewer than two reversals."""
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
        sentence = f"Around reversals: the motion turns only {turns.size} times, too few to evaluate."
        return View("reversals", 0.0, 1.0, sentence, empty, {"opposed": False})
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
    chance = probability(average.p_value)
    significant = average.p_value < SIGNIFICANT
    opposed = bool(significant and change > max(3 * deviation, 0.5 * np.sqrt(residual.explainable)))
    sentence = f"Around reversals: no change is significant ({chance}, {turns.size} reversals)."
    if significant:
        sentence = (
            f"Around reversals: the time since the last of {turns.size} reversals and its direction account for "
            f"{only(average.share)} of the {residual.base_words} ({chance}); the error along the motion changes by {change:+.3g} "
            f"± {2 * deviation:.2g} {residual.unit} within {half * residual.sampling_time:.2g} s of them"
        )
        sentence += (
            ": a force against the motion, or its memory, is not modelled correctly." if opposed else "."
        )
    numbers = {
        "reversals": int(turns.size),
        "change": change,
        "change_deviation": deviation,
        "opposed": opposed,
    }
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
