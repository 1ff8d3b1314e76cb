"""Where in space a model fails: along the travel and across it, over its direction, where the error points, what work it does.

Noise alone decides here too what is significant: its spectrum along every axis, and how the axes' noise goes together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy

from lumbar.tissue.diagnosis.residuals.locate import ALL_BUT_NOISE
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
"""Cells of the sphere of directions, all of one size: bands between heights, each divided about the last axis."""
_SECTORS = 24
"""Cells of a plane's directions."""
_RESTS = 0.1
"""Share of the RMS speed below which the direction of travel is unknown."""
_SPEEDS = 3
_FEWEST = 5
_WORTH = 0.005
_ALIKE = 1.5
"""Largest ratio of principal variances of an error without a preferred direction."""
_MILLIJOULE = ("N", "mm")


@dataclass(frozen=True, eq=False)
class SpatialResidual:
    """Measured less simulated force of one record of several axes, from the first sample that counts."""

    axes: tuple[str, ...]
    parts: tuple[Residual, ...]
    """Along every axis."""
    force: np.ndarray
    """Shape (axes, samples): measured."""
    correlation: np.ndarray
    """Shape (axes, axes): of the noise of the axes."""

    @cached_property
    def values(self) -> np.ndarray:
        """Shape (axes, samples)."""
        return np.stack([part.values for part in self.parts])

    @cached_property
    def noise(self) -> np.ndarray:
        """Covariance of the noise of one sample, shape (axes, axes); 0 where it is unknown."""
        sizes = np.array([0.0 if part.floor is None else part.floor.rms for part in self.parts])
        return self.correlation * np.outer(sizes, sizes)

    @cached_property
    def variance(self) -> float:
        """Mean squared error, of all axes together."""
        return float(np.sum(self.values**2)) / self.samples

    @cached_property
    def explainable(self) -> float:
        """Variance less that of the noise."""
        return max(self.variance - float(np.trace(self.noise)), 0.0)

    @property
    def is_all_but_noise(self) -> bool:
        """Whether the error hardly exceeds the noise floor."""
        return self.variance < ALL_BUT_NOISE**2 * float(np.trace(self.noise))

    @property
    def samples(self) -> int:
        """Samples that count."""
        return self.values.shape[1]

    @property
    def unit(self) -> str:
        """Unit of the force."""
        return self.parts[0].unit

    @property
    def base_words(self) -> str:
        """Reference of all shares."""
        return self.parts[0].base_words

    @cached_property
    def speed(self) -> np.ndarray:
        """Speed in space, shape (samples,)."""
        return np.linalg.norm([part.velocity for part in self.parts], axis=0)

    @cached_property
    def moving(self) -> np.ndarray:
        """Whether the direction of travel is known, shape (samples,)."""
        return self.speed > _RESTS * np.sqrt(np.mean(self.speed**2))

    @cached_property
    def travel(self) -> np.ndarray:
        """Unit vectors of the direction of travel, shape (axes, samples); 0 where it is not known."""
        velocity = np.stack([part.velocity for part in self.parts])
        return np.where(self.moving, velocity / np.where(self.moving, self.speed, 1.0), 0.0)

    def covariance(self, weights: np.ndarray) -> np.ndarray:
        """Covariance of the sums Σₐₙ weights[i, a, n] eₐₙ under noise alone; shape (sums, sums)."""
        noisy = [part.noise_parts(weights[:, axis]) for axis, part in enumerate(self.parts)]
        pairs = np.ndindex(self.correlation.shape)
        return sum(self.correlation[a, b] * noisy[a] @ noisy[b].T for a, b in pairs if self.correlation[a, b])

    def covariance_of_vectors(self, weights: np.ndarray) -> np.ndarray:
        """Covariance of the vectors Σₙ weights[i, n] eₙ under noise alone; shape (sums × axes, sums × axes)."""
        noisy = [part.noise_parts(weights) for part in self.parts]
        products = [[one @ other.T for other in noisy] for one in noisy]
        blocks = self.correlation[:, :, None, None] * np.array(products)
        size = len(weights) * len(noisy)
        return blocks.transpose(2, 0, 3, 1).reshape(size, size)

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom that the noise is known with; without end where it is not known at all."""
        floors = (part.floor for part in self.parts)
        return min((floor.degrees_of_freedom for floor in floors if floor is not None), default=np.inf)

    def p_value(self, sums: np.ndarray, covariance: np.ndarray) -> float:
        """Probability that noise alone gives sums as large."""
        return chi_square_p(sums, covariance, noise_freedom=self.noise_freedom)

    def share(self, explained: Callable[[np.ndarray], float], noise: float) -> float:
        """Share of the explainable error by `share_beyond_chance`; values have the shape (axes, samples)."""
        return share_beyond_chance(self.values, self.explainable, self.parts[0].span, explained, noise)


def travel_view(residual: SpatialResidual) -> View:
    """Error along the direction of travel and across it, and its mean along the travel by speed.

    Columns ``speed``, ``mean``, ``deviation`` (under noise).
    """
    speed = np.where(residual.moving, residual.speed, np.nan)
    edges = np.nanquantile(speed, np.linspace(0, 1, _SPEEDS + 1)[1:-1])
    group = np.where(residual.moving, np.searchsorted(edges, residual.speed, side="right"), -1)
    member = group == np.arange(_SPEEDS)[:, None]
    number = member.sum(axis=1)
    weights = member[:, None] * residual.travel / number[:, None, None]
    mean = np.einsum("ian,an->i", weights, residual.values)
    covariance = residual.covariance(weights)
    often = number / residual.samples

    def explained(values: np.ndarray) -> float:
        return float(often @ np.einsum("ian,an->i", weights, values) ** 2)

    share = residual.share(explained, float(often @ np.diag(covariance)))
    p_value = residual.p_value(mean, covariance)
    along, across = _along_and_across(residual)
    speeds = np.array([residual.speed[one].mean() for one in member])
    seen = p_value < SIGNIFICANT and share >= _WORTH
    unit, error = residual.unit, residual.base_words
    if seen:
        speed_unit = f"{residual.parts[0].position_unit}/s"
        trend = (
            f"the mean along the travel runs from {mean[0]:+.3g} {unit} at {speeds[0]:.3g} {speed_unit} to {mean[-1]:+.3g} "
            f"{unit} at {speeds[-1]:.3g} {speed_unit}, {percent(share)} of the {error} ({probability(p_value)})"
        )
        if (mean > 0).all() or (mean < 0).all():
            less_or_more = "more" if mean[0] > 0 else "less"
            trend += f": on average the tissue resists the motion {less_or_more} than the model does"
    elif p_value >= SIGNIFICANT:
        trend = f"the mean along the travel is no larger than noise makes it ({probability(p_value)})"
    else:
        trend = "the mean along the travel is no larger than an error of this size has by chance"
    split = (
        f"{percent(along)} of the moving tool's {error} is along its direction of travel, {percent(across)} across it "
        f"({percent(1 / len(residual.axes))} along if the two are unrelated); "
    )
    sentence = f"Along the travel: {'' if residual.is_all_but_noise else split}{trend}."
    table = {"speed": speeds, "mean": mean, "deviation": np.sqrt(np.diag(covariance))}
    numbers = {"along": along, "across": across}
    return View("travel", share if seen else 0.0, p_value, sentence, table, numbers)


def _along_and_across(residual: SpatialResidual) -> tuple[float, float]:
    """Shares of the moving tool's error, without noise, along the direction of travel and across it."""
    travel, values = residual.travel[:, residual.moving], residual.values[:, residual.moving]
    along = np.mean(np.sum(travel * values, axis=0) ** 2)
    noise_along = np.mean(np.einsum("an,ab,bn->n", travel, residual.noise, travel))
    both = np.mean(np.sum(values**2, axis=0)) - np.trace(residual.noise)
    if both <= 0:
        return 0.0, 0.0
    share = float(np.clip((along - noise_along) / both, 0.0, 1.0))
    return share, 1 - share


def directions(axes: int) -> np.ndarray:
    """Middles of the cells of directions, unit vectors of shape (cells, axes)."""
    if axes == 2:
        angle = (np.arange(_SECTORS) + 0.5) * 2 * np.pi / _SECTORS
        return np.column_stack([np.cos(angle), np.sin(angle)])
    height = (np.arange(BANDS) + 0.5) * 2 / BANDS - 1
    turn = (np.arange(TURNS) + 0.5) * 2 * np.pi / TURNS - np.pi
    high, round_ = (item.ravel() for item in np.meshgrid(height, turn, indexing="ij"))
    wide = np.sqrt(1 - high**2)
    return np.column_stack([wide * np.cos(round_), wide * np.sin(round_), high])


def cells(vectors: np.ndarray) -> np.ndarray:
    """Number of the cell of each direction, in the order of `directions`; vectors of shape (axes, samples)."""
    turn = np.arctan2(vectors[1], vectors[0])
    if len(vectors) == 2:
        return np.floor((turn % (2 * np.pi)) * _SECTORS / (2 * np.pi)).astype(int) % _SECTORS
    length = np.linalg.norm(vectors, axis=0)
    height = vectors[2] / np.where(length > 0, length, 1.0)
    band = np.clip(np.floor((height + 1) * BANDS / 2).astype(int), 0, BANDS - 1)
    return band * TURNS + np.clip(np.floor((turn + np.pi) * TURNS / (2 * np.pi)).astype(int), 0, TURNS - 1)


def direction_view(residual: SpatialResidual) -> View:
    """Mean error over the direction of travel.

    Columns ``count`` and ``rms`` of the error for every cell of `directions`, and the mean's components.
    """
    count, size = len(directions(len(residual.axes))), len(residual.axes)
    cell = np.where(residual.moving, cells(residual.travel), -1)
    number = np.bincount(cell[residual.moving], minlength=count)
    filled = np.flatnonzero(number >= _FEWEST)
    member = (cell == filled[:, None]) / number[filled, None]
    means = member @ residual.values.T
    covariance = residual.covariance_of_vectors(member)
    often = number[filled] / residual.samples

    def explained(values: np.ndarray) -> float:
        return float(often @ np.sum((member @ values.T) ** 2, axis=1))

    share = residual.share(explained, float(np.repeat(often, size) @ np.diag(covariance)))
    p_value = residual.p_value(means.ravel(), covariance)
    vectors = np.full((count, size), np.nan)
    vectors[filled] = means
    rms = np.full(count, np.nan)
    rms[filled] = np.sqrt(member @ np.sum(residual.values**2, axis=0))
    seen = p_value < SIGNIFICANT and share >= _WORTH
    if seen:
        largest = int(np.nanargmax(np.linalg.norm(vectors, axis=1)))
        vector, way = vectors[largest], directions(size)[largest]
        length = float(np.linalg.norm(vector))
        angle = float(np.degrees(np.arccos(np.clip(vector @ way / length, -1, 1))))
        sentence = (
            f"Over the direction of travel: {percent(share)} of the {residual.base_words} depends on it "
            f"({probability(p_value)}); the mean error is largest, {length:.3g} {residual.unit}, for motion along "
            f"{in_words(way)}, at {angle:.0f}° from it."
        )
    elif p_value >= SIGNIFICANT:
        sentence = f"Over the direction of travel: the mean error does not significantly depend on it ({probability(p_value)})."
    else:
        sentence = "Over the direction of travel: the mean error depends on it no more than an error of this size does by chance."
    table = {"count": number, "rms": rms}
    table |= {f"mean_{axis}": vectors[:, place] for place, axis in enumerate(residual.axes)}
    return View("direction of travel", share if seen else 0.0, p_value, sentence, table)


def upward(direction: np.ndarray) -> np.ndarray:
    """An axis has no sign: its largest component is taken as positive."""
    return direction * np.sign(direction[np.argmax(np.abs(direction))])


def in_words(direction: Sequence[float]) -> str:
    """Components of a unit vector for a sentence."""
    return f"({', '.join(f'{part + 0.0:.2f}' for part in np.round(direction, 2))})"


def pointing_view(residual: SpatialResidual) -> View:
    """Principal directions of the error's covariance, without that of the noise.

    Columns ``share`` and the components of every principal direction, the largest first.
    """
    values = residual.values
    covariance = values @ values.T / residual.samples
    sizes, vectors = np.linalg.eigh(covariance - residual.noise)
    order = np.argsort(-sizes)
    total = residual.explainable or 1.0
    shares, vectors = np.clip(sizes[order] / total, 0.0, 1.0), vectors[:, order]
    vectors = np.transpose([upward(vector) for vector in vectors.T])
    p_value = _sphericity_p(residual, covariance)
    pointed = sizes[order[0]] > _ALIKE * max(sizes[order[-1]], 0.0)
    seen = pointed and p_value < SIGNIFICANT
    if seen:
        parts = zip(shares, vectors.T, strict=True)
        told = ", ".join(f"{percent(share)} along {in_words(vector)}" for share, vector in parts)
        sentence = f"Direction of the error: {told} ({probability(p_value)})."
    elif not pointed and not residual.is_all_but_noise:
        sentence = "Direction of the error: it is about equal in all directions."
    else:
        sentence = f"Direction of the error: no direction stands out of the noise ({probability(p_value)})."
    table = {"share": shares}
    table |= {f"direction_{axis}": vectors[place] for place, axis in enumerate(residual.axes)}
    return View("direction of the error", float(shares[0]) if seen else 0.0, p_value, sentence, table)


def _sphericity_p(residual: SpatialResidual, covariance: np.ndarray) -> float:
    """Return the probability that noise has as clear a direction by chance (John's test on whitened axes).

    Without a noise floor the error of the axes replaces the noise, and the test only sees their correlation.
    """
    size = len(covariance)
    floors = [part.floor for part in residual.parts]
    noise = residual.noise if all(floors) else np.diag(np.diag(covariance))
    root = np.linalg.cholesky(np.linalg.inv(noise + 1e-12 * np.trace(noise) * np.eye(size)))
    white = root.T @ covariance @ root
    white *= size / np.trace(white)
    independent = min(residual.samples, *map(_independent, residual.parts))
    statistic = (
        0.5 * independent * np.sum((white - np.eye(size)) ** 2) / (1 + independent / residual.noise_freedom)
    )
    return float(scipy.special.chdtrc(size * (size + 1) / 2 - 1, statistic))


def _independent(part: Residual) -> float:
    """Samples of white noise whose mean square scatters as that of this record's noise, which may be coloured."""
    power = part.noise_power(np.fft.rfftfreq(len(part.values), part.sampling_time))
    return len(part.values) * float(np.mean(power) ** 2 / np.mean(power**2))


def work_view(residual: SpatialResidual, frame: np.ndarray | None = None) -> View:
    """Work of the measured and of the simulated force: of a period if the record repeats, else of the whole record.

    `frame` has the directions of work in its columns, default those of the record's axes. Columns
    ``measured``, ``simulated``, ``deviation`` (under noise), and the directions' components.
    """
    names = residual.axes if frame is None else [in_words(way) for way in frame.T]
    frame = np.eye(len(residual.axes)) if frame is None else frame
    steps = np.stack([np.gradient(part.position) for part in residual.parts])
    folding = residual.parts[0].folding
    counted = np.ones(residual.samples)
    if folding is not None:
        counted = np.bincount(folding.rows.ravel(), minlength=residual.samples) / len(folding.rows)
    moved = frame.T @ (counted * steps)
    weights = frame.T[:, :, None] * moved[:, None]
    measured = np.einsum("ian,an->i", weights, residual.force)
    missing = np.einsum("ian,an->i", weights, residual.values)
    covariance = residual.covariance(weights)
    p_value = residual.p_value(missing, covariance)
    units = (residual.unit, residual.parts[0].position_unit)
    work = "mJ" if units == _MILLIJOULE else "·".join(units)
    over = "the record" if folding is None else f"a period of {folding.period:.3g} s"
    sentence = f"Work: over {over} the tool does {measured.sum():.4g} {work} on the tissue"
    if p_value < SIGNIFICANT:
        by_direction = "; ".join(
            f"{_plain(one)} ({_plain(less, '+')}) along {name}"
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


def _plain(value: float, sign: str = "") -> str:
    """Three significant digits, written out."""
    return f"{float(f'{value:.3g}'):{sign}g}"


def views_in_space(residual: SpatialResidual, frame: np.ndarray | None = None) -> dict[str, View]:
    """Return all views by name; `frame` is that of `work_view`."""
    views = (travel_view, direction_view, pointing_view, partial(work_view, frame=frame))
    return {view.name: view for view in (see(residual) for see in views)}
