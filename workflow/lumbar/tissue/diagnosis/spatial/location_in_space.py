"""Views of a model's error in space: along and over the direction of travel, direction of the error, and work.

Significance is tested against noise with its spectrum along every axis and its correlation between the axes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from lumbar.tissue.diagnosis.residuals.locate import NEAR_FLOOR_RATIO
from lumbar.tissue.diagnosis.residuals.residual import (
    SIGNIFICANT,
    Residual,
    View,
    chi_square_p,
    percent,
    probability,
    share_beyond_chance,
)

BANDS, TURNS = 6, 12
"""Numbers of bands in height, and of cells in a band, of the sphere of directions; all cells have the same area."""
_SECTORS = 24
"""Number of cells of the directions in a plane."""
_MIN_SPEED = 0.1
"""Share of the RMS speed below which the direction of travel is undefined."""
_SPEED_GROUPS = 3
_MIN_CELL_SAMPLES = 5
_MIN_SHARE = 0.005
"""Share of the explainable error above which a significant view is reported."""
_MAX_VARIANCE_RATIO = 1.5
"""Largest ratio of principal variances of an error without a preferred direction."""


@dataclass(frozen=True, eq=False)
class SpatialResidual:
    """Measured minus simulated force of one record of several axes after the settling time."""

    axes: tuple[str, ...]
    parts: tuple[Residual, ...]
    """Residual along every axis."""
    force: np.ndarray
    """Measured force, shape (axes, samples)."""
    correlation: np.ndarray
    """Correlation of the noise of the axes, shape (axes, axes)."""

    @cached_property
    def values(self) -> np.ndarray:
        """Residuals along the axes, shape (axes, samples)."""
        return np.stack([part.values for part in self.parts])

    @cached_property
    def noise(self) -> np.ndarray:
        """Covariance of the noise of one sample, shape (axes, axes); 0 if it is unknown."""
        sizes = np.array([0.0 if part.floor is None else part.floor.rms for part in self.parts])
        return self.correlation * np.outer(sizes, sizes)

    @cached_property
    def variance(self) -> float:
        """Mean squared error, summed over the axes."""
        return float(np.sum(self.values**2)) / self.samples

    @cached_property
    def explainable(self) -> float:
        """Mean squared error minus the variance of the noise."""
        return max(self.variance - float(np.trace(self.noise)), 0.0)

    @property
    def is_near_noise_floor(self) -> bool:
        """True if the error hardly exceeds the noise floor."""
        return self.variance < NEAR_FLOOR_RATIO**2 * float(np.trace(self.noise))

    @property
    def samples(self) -> int:
        """Number of samples after the settling time."""
        return self.values.shape[1]

    @property
    def unit(self) -> str:
        """Unit of the force."""
        return self.parts[0].unit

    @cached_property
    def speed(self) -> np.ndarray:
        """Speed in space, shape (samples,)."""
        return np.linalg.norm([part.velocity for part in self.parts], axis=0)

    @cached_property
    def moving(self) -> np.ndarray:
        """True at samples with a direction of travel, shape (samples,)."""
        return self.speed > _MIN_SPEED * np.sqrt(np.mean(self.speed**2))

    @cached_property
    def travel(self) -> np.ndarray:
        """Unit vectors of the direction of travel, shape (axes, samples); 0 at samples without direction."""
        velocity = np.stack([part.velocity for part in self.parts])
        return np.where(self.moving, velocity / np.where(self.moving, self.speed, 1.0), 0.0)

    def covariance(self, weights: np.ndarray) -> np.ndarray:
        """Return the covariance of the sums Σₐₙ weights[i, a, n] eₐₙ under noise only, shape (sums, sums)."""
        noisy = [part.noise_parts(weights[:, axis]) for axis, part in enumerate(self.parts)]
        pairs = np.ndindex(self.correlation.shape)
        return sum(self.correlation[a, b] * noisy[a] @ noisy[b].T for a, b in pairs if self.correlation[a, b])

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise floor; ∞ without one."""
        floors = (part.floor for part in self.parts)
        return min((floor.degrees_of_freedom for floor in floors if floor is not None), default=np.inf)

    def p_value(self, sums: np.ndarray, covariance: np.ndarray) -> float:
        """Return the probability that noise only gives such large sums."""
        return chi_square_p(sums, covariance, noise_freedom=self.noise_freedom)

    def share(self, explained: Callable[[np.ndarray], float], noise: float) -> float:
        """Return the share of the explainable error by `share_beyond_chance`; values have the shape (axes, samples)."""
        return share_beyond_chance(self.values, self.explainable, self.parts[0].span, explained, noise)


def travel_view(residual: SpatialResidual) -> View:
    """Return the error along the direction of travel and across it, and its mean along the travel by speed.

    The table has the columns ``speed``, ``mean``, ``deviation`` (under noise).
    """
    speed = np.where(residual.moving, residual.speed, np.nan)
    edges = np.nanquantile(speed, np.linspace(0, 1, _SPEED_GROUPS + 1)[1:-1])
    group = np.where(residual.moving, np.searchsorted(edges, residual.speed, side="right"), -1)
    member = group == np.arange(_SPEED_GROUPS)[:, None]
    number = member.sum(axis=1)
    weights = member[:, None] * residual.travel / number[:, None, None]
    mean = np.einsum("ian,an->i", weights, residual.values)
    covariance = residual.covariance(weights)
    frequency = number / residual.samples

    def explained(values: np.ndarray) -> float:
        return float(frequency @ np.einsum("ian,an->i", weights, values) ** 2)

    share = residual.share(explained, float(frequency @ np.diag(covariance)))
    p_value = residual.p_value(mean, covariance)
    speeds = np.array([residual.speed[one].mean() for one in member])
    is_reported = p_value < SIGNIFICANT and share >= _MIN_SHARE
    unit, error = residual.unit, residual.parts[0].error_name
    if is_reported:
        speed_unit = f"{residual.parts[0].position_unit}/s"
        trend = (
            f"the mean along the travel runs from {mean[0]:+.3g} {unit} at {speeds[0]:.3g} {speed_unit} to {mean[-1]:+.3g} "
            f"{unit} at {speeds[-1]:.3g} {speed_unit}, {percent(share)} of the {error} ({probability(p_value)})"
        )
        if (mean > 0).all() or (mean < 0).all():
            less_or_more = "more" if mean[0] > 0 else "less"
            trend += f": on average the tissue resists the motion {less_or_more} than the model does"
    elif p_value >= SIGNIFICANT:
        trend = f"the mean along the travel does not exceed the noise ({probability(p_value)})"
    else:
        trend = "the mean along the travel does not exceed that of a random error of this size"
    # Shares of the moving tool's error, without noise, along the direction of travel and across it.
    travel, values = residual.travel[:, residual.moving], residual.values[:, residual.moving]
    squares_along = np.mean(np.sum(travel * values, axis=0) ** 2)
    noise_along = np.mean(np.einsum("an,ab,bn->n", travel, residual.noise, travel))
    both = np.mean(np.sum(values**2, axis=0)) - np.trace(residual.noise)
    along, across = 0.0, 0.0
    if both > 0:
        along = float(np.clip((squares_along - noise_along) / both, 0.0, 1.0))
        across = 1 - along
    split = (
        f"{percent(along)} of the moving tool's {error} is along its direction of travel, {percent(across)} across it "
        f"({percent(1 / len(residual.axes))} along if the two are unrelated); "
    )
    sentence = f"Along the travel: {'' if residual.is_near_noise_floor else split}{trend}."
    table = {"speed": speeds, "mean": mean, "deviation": np.sqrt(np.diag(covariance))}
    numbers = {"along": along, "across": across}
    return View("travel", share if is_reported else 0.0, p_value, sentence, table, numbers)


def directions(axes: int) -> np.ndarray:
    """Return the centres of the cells of directions in space or in a plane, unit vectors of shape (cells, axes)."""
    if axes == 2:
        angle = (np.arange(_SECTORS) + 0.5) * 2 * np.pi / _SECTORS
        return np.column_stack([np.cos(angle), np.sin(angle)])
    height = (np.arange(BANDS) + 0.5) * 2 / BANDS - 1
    turn = (np.arange(TURNS) + 0.5) * 2 * np.pi / TURNS - np.pi
    heights, angles = (item.ravel() for item in np.meshgrid(height, turn, indexing="ij"))
    radius = np.sqrt(1 - heights**2)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), heights])


def cells(vectors: np.ndarray) -> np.ndarray:
    """Return the number of the cell of every vector, in the order of `directions`; vectors of shape (axes, samples)."""
    turn = np.arctan2(vectors[1], vectors[0])
    if len(vectors) == 2:
        return np.floor((turn % (2 * np.pi)) * _SECTORS / (2 * np.pi)).astype(int) % _SECTORS
    length = np.linalg.norm(vectors, axis=0)
    height = vectors[2] / np.where(length > 0, length, 1.0)
    band = np.clip(np.floor((height + 1) * BANDS / 2).astype(int), 0, BANDS - 1)
    return band * TURNS + np.clip(np.floor((turn + np.pi) * TURNS / (2 * np.pi)).astype(int), 0, TURNS - 1)


def direction_view(residual: SpatialResidual) -> View:
    """Return the mean error over the direction of travel.

    The table has ``count`` and ``rms`` of the error for every cell of `directions`, and the components of the mean.
    """
    size = len(residual.axes)
    centres = directions(size)
    cell = np.where(residual.moving, cells(residual.travel), -1)
    number = np.bincount(cell[residual.moving], minlength=len(centres))
    filled = np.flatnonzero(number >= _MIN_CELL_SAMPLES)
    member = (cell == filled[:, None]) / number[filled, None]
    means = member @ residual.values.T
    # Covariance of the mean vectors of all cells under noise only, shape (cells × axes, cells × axes).
    noisy = [part.noise_parts(member) for part in residual.parts]
    products = np.array([[one @ other.T for other in noisy] for one in noisy])
    blocks = residual.correlation[:, :, None, None] * products
    covariance = blocks.transpose(2, 0, 3, 1).reshape(means.size, means.size)
    frequency = number[filled] / residual.samples

    def explained(values: np.ndarray) -> float:
        return float(frequency @ np.sum((member @ values.T) ** 2, axis=1))

    share = residual.share(explained, float(np.repeat(frequency, size) @ np.diag(covariance)))
    p_value = residual.p_value(means.ravel(), covariance)
    vectors, rms = np.full((len(centres), size), np.nan), np.full(len(centres), np.nan)
    vectors[filled] = means
    rms[filled] = np.sqrt(member @ np.sum(residual.values**2, axis=0))
    is_reported = p_value < SIGNIFICANT and share >= _MIN_SHARE
    if is_reported:
        largest = int(np.nanargmax(np.linalg.norm(vectors, axis=1)))
        vector, travel = vectors[largest], centres[largest]
        length = float(np.linalg.norm(vector))
        angle = float(np.degrees(np.arccos(np.clip(vector @ travel / length, -1, 1))))
        text = (
            f"{percent(share)} of the {residual.parts[0].error_name} depends on it ({probability(p_value)}); the mean error is "
            f"largest, {length:.3g} {residual.unit}, for motion along {vector_text(travel)}, at {angle:.0f}° from it"
        )
    elif p_value >= SIGNIFICANT:
        text = f"the mean error does not significantly depend on it ({probability(p_value)})"
    else:
        text = "the mean error depends on it no more than an error of this size does by chance"
    table = {"count": number, "rms": rms}
    table |= {f"mean_{axis}": vectors[:, place] for place, axis in enumerate(residual.axes)}
    sentence = f"Over the direction of travel: {text}."
    return View("direction of travel", share if is_reported else 0.0, p_value, sentence, table)


def upward(direction: np.ndarray) -> np.ndarray:
    """Return the direction of an axis with the sign that makes its largest component positive."""
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def vector_text(direction: Sequence[float]) -> str:
    """Format the components of a unit vector for a sentence."""
    return f"({', '.join(f'{part + 0.0:.2f}' for part in np.round(direction, 2))})"


def error_direction_view(residual: SpatialResidual) -> View:
    """Return the principal directions of the error's covariance, without that of the noise.

    The table has ``share`` and the components of every principal direction, the largest share first.
    """
    values = residual.values
    covariance = values @ values.T / residual.samples
    sizes, vectors = np.linalg.eigh(covariance - residual.noise)
    order = np.argsort(-sizes)
    shares = np.clip(sizes[order] / (residual.explainable or 1.0), 0.0, 1.0)
    vectors = np.transpose([upward(vector) for vector in vectors[:, order].T])
    p_value = _sphericity_p(residual, covariance)
    has_direction = sizes[order[0]] > _MAX_VARIANCE_RATIO * max(sizes[order[-1]], 0.0)
    is_reported = has_direction and p_value < SIGNIFICANT
    if is_reported:
        parts = zip(shares, vectors.T, strict=True)
        text = ", ".join(f"{percent(share)} along {vector_text(vector)}" for share, vector in parts)
        text += f" ({probability(p_value)})"
    elif not has_direction and not residual.is_near_noise_floor:
        text = "it is about equal in all directions"
    else:
        text = f"no direction exceeds the noise ({probability(p_value)})"
    table = {"share": shares}
    table |= {f"direction_{axis}": vectors[place] for place, axis in enumerate(residual.axes)}
    largest = float(shares[0]) if is_reported else 0.0
    return View("direction of the error", largest, p_value, f"Direction of the error: {text}.", table)


def _sphericity_p(residual: SpatialResidual, covariance: np.ndarray) -> float:
    """Return the probability of as clear a direction in noise by chance (John's test on whitened axes).

    Without a noise floor the variances of the error replace those of the noise, and the test only detects correlation.
    """
    size = len(covariance)
    noise = residual.noise if all(part.floor for part in residual.parts) else np.diag(np.diag(covariance))
    root = np.linalg.cholesky(np.linalg.inv(noise + 1e-12 * np.trace(noise) * np.eye(size)))
    white = root.T @ covariance @ root
    white *= size / np.trace(white)
    # Number of samples of white noise with a mean square as uncertain as that of the record's noise, which may be coloured.
    independent = float(residual.samples)
    for part in residual.parts:
        power = part.noise_power(np.fft.rfftfreq(len(part.values), part.sampling_time))
        independent = min(independent, len(part.values) * float(np.mean(power) ** 2 / np.mean(power**2)))
    statistic = 0.5 * independent * np.sum((white - np.eye(size)) ** 2)
    statistic /= 1 + independent / residual.noise_freedom
    return float(scipy.special.chdtrc(size * (size + 1) / 2 - 1, statistic))


def work_view(residual: SpatialResidual, frame: np.ndarray | None = None) -> View:
    """Return the work of the measured and of the simulated force, over a period if the record repeats, else over the record.

    `frame` has the directions of work in its columns; default the axes of the record. The table has the columns ``measured``,
    ``simulated``, ``deviation`` (under noise), and the components of the directions.
    """
    names = residual.axes if frame is None else [vector_text(direction) for direction in frame.T]
    frame = np.eye(len(residual.axes)) if frame is None else frame
    steps = np.stack([np.gradient(part.position) for part in residual.parts])
    folding = residual.parts[0].folding
    counted = np.ones(residual.samples)
    if folding is not None:
        counted = np.bincount(folding.rows.ravel(), minlength=residual.samples) / len(folding.rows)
    weights = frame.T[:, :, None] * (frame.T @ (counted * steps))[:, None]
    measured = np.einsum("ian,an->i", weights, residual.force)
    missing = np.einsum("ian,an->i", weights, residual.values)
    covariance = residual.covariance(weights)
    p_value = residual.p_value(missing, covariance)
    units = (residual.unit, residual.parts[0].position_unit)
    work = "mJ" if units == ("N", "mm") else "·".join(units)
    over = "the record" if folding is None else f"a period of {folding.period:.3g} s"
    sentence = f"Work: over {over} the tool does {measured.sum():.4g} {work} on the tissue"
    if p_value < SIGNIFICANT:
        by_direction = "; ".join(
            f"{float(f'{one:.3g}'):g} ({float(f'{less:.3g}'):+g}) along {name}"
            for one, less, name in zip(measured, missing, names, strict=True)
        )
        sentence += (
            f", {abs(missing.sum()):.4g} {work} {'more' if missing.sum() > 0 else 'less'} than on the model "
            f"({probability(p_value)}); by direction, with the difference in brackets, {by_direction}."
        )
    else:
        sentence += f", and as much on the model, within noise ({probability(p_value)})."
    table = {"measured": measured, "simulated": measured - missing, "deviation": np.sqrt(np.diag(covariance))}
    table |= {f"direction_{axis}": frame[place] for place, axis in enumerate(residual.axes)}
    return View("work", None, p_value, sentence, table)
