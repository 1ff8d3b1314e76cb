"""Location of a model's error in the motion: over position and velocity, and around reversals."""

import numpy as np

from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Average,
    Residual,
    View,
    format_share,
    percent,
    probability,
)

DEPTHS = 20
_POSITIONS, _SPEEDS = 12, 5
_MIN_SAMPLES = 5
_SIGNIFICANT_SIGMAS = 3.0
"""Smallest mean of a single cell of the map that exceeds the noise, in standard deviations."""
_MOST_OF_ERROR = 0.8
_MIN_TURN_SHARE = 0.03
"""Smallest motion between two reversals that count, as a share of the position's range."""
_MIN_MIRRORED_SHARE = 0.6
"""Smallest share of the map's energy in bins with a visited mirrored bin, for a split into even and odd parts."""
_DEPTH_COLUMNS = ("position", "mean", "deviation", "advancing", "retracting")


def motion_view(residual: Residual) -> View:
    """Return the mean residual over position and velocity, and over position only, advancing and retracting.

    The table has the columns ``position``, ``mean``, ``deviation`` (under noise), and means ``advancing``, ``retracting``. The
    numbers are ``even_share``, ``odd_share`` (of the map over position and velocity), ``depth_share`` and ``depth_p`` (of
    position only). Share and p-value of the view belong to the map.
    """
    name = "position and velocity"
    if np.ptp(residual.position) == 0:
        empty = {column: np.zeros(0) for column in _DEPTH_COLUMNS}
        numbers = {"even_share": None, "odd_share": None, "depth_share": 0.0, "depth_p": 1.0}
        sentence = f"Over {name}: the {residual.moved} does not move in this part."
        return View(name, 0.0, 1.0, sentence, empty, numbers)
    # The map: cells of position and velocity with enough samples.
    position_edges, velocity_edges = map_edges(residual.position, residual.velocity)
    columns, rows = len(position_edges) - 1, len(velocity_edges) - 1
    cell = binned(residual.velocity, velocity_edges) * columns + binned(residual.position, position_edges)
    average = residual.averages(_drop_small_groups(cell), rows * columns)
    even, odd = _even_odd(residual, average, rows, columns, position_edges, velocity_edges)
    # The same over position by itself.
    edges = spread_edges(residual.position, DEPTHS)
    count = len(edges) - 1
    groups = _drop_small_groups(binned(residual.position, edges))
    depth = residual.averages(groups, count)

    def means(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
        number = np.bincount(groups[inside], minlength=count)
        sums = np.bincount(groups[inside], values[inside], count)
        return np.where(number >= _MIN_SAMPLES, sums / np.maximum(number, 1), np.nan)

    position = means(residual.position, groups >= 0)
    advancing = means(residual.values, (groups >= 0) & (residual.velocity > 0))
    retracting = means(residual.values, (groups >= 0) & (residual.velocity < 0))
    columns_of_depth = (position, depth.mean, depth.deviation, advancing, retracting)
    table = dict(zip(_DEPTH_COLUMNS, columns_of_depth, strict=True))
    numbers = {"even_share": even, "odd_share": odd}
    numbers |= {"depth_share": depth.significant_share, "depth_p": depth.p_value}
    chance = probability(average.p_value)
    both = f"Over {name}: the mean error depends on neither ({chance})"
    if average.p_value < SIGNIFICANT:
        share = format_share(average.share)
        both = (
            f"Over {name}: their present values account for {share} of the {residual.error_name} ({chance})"
        )
        if even is not None:
            both += f", {percent(odd)} with a force mirrored with the motion (odd), {percent(even)} with another one (even)"
        if not np.any(np.abs(average.mean / average.deviation) >= _SIGNIFICANT_SIGMAS):
            both += ", as a pattern: no single cell exceeds the noise"
        rest = "little remains for" if average.share > _MOST_OF_ERROR else "the rest needs"
        # The cell of the map with the largest mean error.
        largest = int(np.nanargmax(np.abs(average.mean)))
        row, column = divmod(largest, columns)
        slow, fast = sorted(np.abs(velocity_edges[row : row + 2]))
        direction, unit = "advancing" if velocity_edges[row + 1] > 0 else "retracting", residual.position_unit
        both += (
            f"; the mean error is largest, {average.mean[largest]:+.3g} {residual.unit}, from {position_edges[column]:.3g} to "
            f"{position_edges[column + 1]:.3g} {unit} while {direction} at {slow:.3g} to {fast:.3g} {unit}/s; {rest} history, "
            "time or faster dynamics"
        )
    sentence = f"{both}. {_depth_sentence(residual, depth, position)}"
    return View(name, average.significant_share, average.p_value, sentence, table, numbers)


def _drop_small_groups(groups: np.ndarray) -> np.ndarray:
    """Return the groups, with −1 for groups of too few samples."""
    return np.where(np.bincount(groups)[groups] >= _MIN_SAMPLES, groups, -1)


def _depth_sentence(residual: Residual, depth: Average, position: np.ndarray) -> str:
    chance, unit, depth_unit = probability(depth.p_value), residual.unit, residual.position_unit
    if depth.p_value >= SIGNIFICANT:
        return f"Over depth the mean error does not change ({chance})."
    mean, shape = depth.mean, ""
    if depth.share > 0.1:
        # Even and odd parts of the curve about the middle of the range.
        mirrored = np.interp(position[0] + position[-1] - position, position, mean)
        noise = np.mean(depth.deviation**2) / 2
        even, odd = (np.mean((part / 2) ** 2) - noise for part in (mean + mirrored, mean - mirrored))
        shape = ", different at the two ends"
        if even > 2 * odd:
            shape = ", equal at both ends (even in position)"
        elif odd > 2 * even:
            shape = ", opposite at both ends (odd in position)"
    low, high = int(np.nanargmin(mean)), int(np.nanargmax(mean))
    return (
        f"Depth by itself accounts for {format_share(depth.share)} of the {residual.error_name} ({chance}); the mean error runs "
        f"from {mean[low]:+.3g} {unit} at {position[low]:.3g} {depth_unit} to {mean[high]:+.3g} {unit} at {position[high]:.3g} "
        f"{depth_unit}{shape}."
    )


def map_edges(position: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of the map's cells along position and along velocity."""
    return _symmetric_edges(position, _POSITIONS // 2), _symmetric_edges(velocity, _SPEEDS)


def binned(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the number of the bin of each value; values beyond the edges are in the outer bins."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def spread_edges(values: np.ndarray, count: int) -> np.ndarray:
    """Return edges halfway between the edges of equally wide bins and of equally filled bins.

    Bins are narrow at frequent values, and not wide at the ends, at which errors are largest. Equal values have one bin.
    """
    filled = np.quantile(values, np.linspace(0, 1, count + 1))
    edges = np.unique((filled + np.linspace(filled[0], filled[-1], count + 1)) / 2)
    return edges if len(edges) > 1 else np.repeat(edges, 2)


def _symmetric_edges(values: np.ndarray, half: int) -> np.ndarray:
    """Return edges of bins that are symmetric about zero if the values are."""
    if min(np.mean(values > 0), np.mean(values < 0)) < 0.25:
        return spread_edges(values, 2 * half)
    edges = spread_edges(np.append(np.abs(values), 0.0), half)[1:]
    return np.unique(np.concatenate([-edges[::-1], [0.0], edges]))


def _even_odd(residual, average, rows, columns, *edges) -> tuple[float | None, float | None]:
    """Return the shares of the map that are even and odd in position and velocity together."""
    if not all(np.allclose(edge, -edge[::-1]) for edge in edges):
        return None, None
    mean = average.mean.reshape(rows, columns)
    mirrored = mean[::-1, ::-1]
    weight = average.count.reshape(rows, columns) / len(residual.values)
    both = np.isfinite(mean) & np.isfinite(mirrored)
    energy = weight * np.nan_to_num(mean) ** 2
    if energy[both].sum() < _MIN_MIRRORED_SHARE * energy.sum():
        return None, None
    variance = average.deviation.reshape(rows, columns) ** 2
    noise = (variance + variance[::-1, ::-1])[both] / 4
    even, odd = ((mean + mirrored) / 2)[both], ((mean - mirrored) / 2)[both]
    return tuple(residual.share(float(weight[both] @ (part**2 - noise))) for part in (even, odd))


def reversals(position: np.ndarray, share: float = _MIN_TURN_SHARE) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of reversals of the motion by more than a `share` of its range, and the direction (±1) after each."""
    least = float(share * np.ptp(position))
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
    """Return the number of samples on either side of a reversal that belong to it; 0 with fewer than two reversals."""
    gaps = np.diff(turns)
    return int(np.clip(0.5 * np.median(gaps), 2, size // 8)) if gaps.size else 0


def reversal_view(residual: Residual) -> View:
    """Return the mean residual around reversals, signed by the direction after them.

    The table has ``time`` (s after the reversal), ``mean`` and ``deviation`` under noise, both of direction times residual.
    """
    size = len(residual.values)
    turns, directions = reversals(residual.position)
    half = reversal_reach(turns, size)
    inside = (turns >= half) & (turns < size - half) & (half > 0)
    turns, directions = turns[inside], directions[inside]
    if turns.size < 4:
        empty = {name: np.zeros(0) for name in ("time", "mean", "deviation")}
        sentence = f"Around reversals: the motion turns only {turns.size} times, too few to evaluate."
        return View("reversals", 0.0, 1.0, sentence, empty, {"opposed": False})
    offsets = np.arange(-half, half + 1, max(1, half // 20))
    weights = np.zeros((len(offsets), size))
    for row, offset in enumerate(offsets):
        np.add.at(weights[row], turns + offset, directions / turns.size)
    mean, covariance = weights @ residual.values, residual.covariance(weights)
    table = {
        "time": offsets * residual.sampling_time,
        "mean": mean,
        "deviation": np.sqrt(np.diag(covariance)),
    }
    contrast = np.sign(offsets) / np.sum(offsets > 0)
    change, deviation = float(contrast @ mean), float(np.sqrt(contrast @ covariance @ contrast))
    # Means over the time since the last reversal, in eight equally filled bins, by direction.
    samples = np.arange(size)
    last = np.searchsorted(turns, samples, side="right") - 1
    since, is_known = samples - turns[np.maximum(last, 0)], last >= 0
    edges = np.unique(np.quantile(since[is_known], np.linspace(0, 1, 9)[1:-1]))
    by_direction = (len(edges) + 1) * (directions[np.maximum(last, 0)] > 0)
    groups = np.where(is_known, np.searchsorted(edges, since, side="right") + by_direction, -1)
    average = residual.averages(groups, 2 * (len(edges) + 1))
    chance = probability(average.p_value)
    opposed = False
    sentence = f"Around reversals: no change is significant ({chance}, {turns.size} reversals)."
    if average.p_value < SIGNIFICANT:
        opposed = bool(change > max(3 * deviation, 0.5 * np.sqrt(residual.explainable)))
        end = ": a force against the motion, or its memory, is not modelled correctly." if opposed else "."
        sentence = (
            f"Around reversals: the time since the last of {turns.size} reversals and its direction account for "
            f"{format_share(average.share)} of the {residual.error_name} ({chance}); the error along the motion changes by "
            f"{change:+.3g} ± {2 * deviation:.2g} {residual.unit} within {half * residual.sampling_time:.2g} s of them{end}"
        )
    numbers = {"change": change, "opposed": opposed}
    return View("reversals", average.significant_share, average.p_value, sentence, table, numbers)
