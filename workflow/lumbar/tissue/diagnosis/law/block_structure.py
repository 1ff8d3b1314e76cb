"""A static curve between linear filters: Wiener (filter, curve), Hammerstein (curve, filter) and both.

Where no effect of the catalogue explains what a linear model leaves, the chain itself may be what is missing: an amplifier or a
sensor with a curve of its own before or behind dynamics, or a tissue whose elastic curve relaxes as a whole (quasi-linear
viscoelasticity, Fung 1972: Hammerstein). The best linear approximation of such a chain has the poles and zeros of all its
filters (Bussgang 1952; Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2012, chapter 3). So these are
shared out between front and back in every way, the curve solved for by linear least squares, and the best ways refined by
their simulation error (Sjöberg and Schoukens, Automatica 48 (2012) 353-359).

Filters are discrete, at the records' own rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
import scipy

from lumbar.tissue.diagnosis.fitting.fit_data import FitData, FreeRun
from lumbar.tissue.diagnosis.fitting.preparation import Experiment
from lumbar.tissue.models.motion import JoinedMotions, Motion

WIENER, HAMMERSTEIN, BOTH = "Wiener", "Hammerstein", "Wiener-Hammerstein"
EXPLAINS = 0.5
"""Unseen error, in that of the best linear model, up to which a chain is told."""
_SIMPLER = 1.05
"""Unseen error, in that of the best chain, up to which one of fewer filters is taken."""
_LONG = 20_000
"""Samples on which ways to share out are compared."""
_KNOTS, _FINE_KNOTS = 8, 14
"""Knots of the curve while ways are compared, and of the result."""
_ORDERS = (2, 3, 6)
"""Orders of the linear approximations whose poles and zeros are shared out."""
_REFINED = 2
"""Ways that are refined on the beginning of the record, of those with as many poles in front and behind."""
_NEARLY_REAL = 0.5
"""Imaginary part of a pole, in its distance from 1, below which a pair may be two real ones, each on its own side."""
_FAR = 20.0
"""Size of a zero that is a gain within the band."""
_TRIED, _ON_THE_WAY = 4, 0.6
"""First ways, and the error of the best of them once refined, in that of the best linear approximation, up to which all are."""
_PROMISING = 1.4
"""Error on the beginning of the record, in that of the best chain, up to which a kind is fitted to all of it."""
_EVALUATIONS, _MORE_EVALUATIONS, _LAST_EVALUATIONS = 25, 60, 30
"""Of the error, at most: of each way, of the best one, and on the whole record."""
_TURNS = 20
_LITTLE, _LINES = 0.05, 2000
"""Static gain, in the largest response, below which a filter counts as one that lets nothing through at rest; angles asked."""
_NEGLIGIBLE = 1e-3
"""Size of a numerator's first coefficients beside its largest, below which they are a delay's."""


@dataclass(frozen=True, eq=False)
class Filter:
    """A rational filter in the delay operator, both polynomials in rising powers of it."""

    numerator: np.ndarray
    denominator: np.ndarray
    """Begins with 1."""

    @property
    def is_static(self) -> bool:
        """Whether it is a gain."""
        return len(self.numerator) == len(self.denominator) == 1

    def apply(self, signal: np.ndarray) -> np.ndarray:
        """Filtered signal (samples first), the first sample's value having stood for ever."""
        rest = self.static_gain * signal[0]
        return scipy.signal.lfilter(self.numerator, self.denominator, signal - signal[0], axis=0) + rest

    @property
    def static_gain(self) -> float:
        """Response to a constant."""
        return float(self.numerator.sum() / self.denominator.sum())

    @property
    def gain(self) -> float:
        """Static gain, or the largest response (with the sign of the static one) where that is `_LITTLE` times as large."""
        largest = float(np.abs(self.response(np.linspace(0, np.pi, _LINES))).max())
        static = self.static_gain
        return static if abs(static) > _LITTLE * largest else float(np.copysign(largest, static))

    def response(self, angle: np.ndarray) -> np.ndarray:
        """Frequency response at these angles per sample, complex."""
        return scipy.signal.freqz(self.numerator, self.denominator, angle)[1]

    def scaled(self, factor: float) -> Filter:
        """The same filter with a gain of this factor."""
        return replace(self, numerator=self.numerator * factor)

    @property
    def poles(self) -> int:
        """Number of poles."""
        return len(self.denominator) - 1

    def to_json(self) -> dict:
        """Both polynomials."""
        return {"numerator": self.numerator.tolist(), "denominator": self.denominator.tolist()}

    def slopes(self, signal: np.ndarray) -> np.ndarray:
        """Derivatives of the filtered signal by the numerator's coefficients and by the denominator's but for the first."""
        moved = signal - signal[0]
        through = scipy.signal.lfilter([1.0], self.denominator, moved)
        answer = scipy.signal.lfilter(
            [1.0], self.denominator, self.apply(signal) - self.static_gain * signal[0]
        )
        delayed = [_delayed(through, lag) for lag in range(len(self.numerator))]
        delayed += [-_delayed(answer, lag) for lag in range(1, len(self.denominator))]
        total = self.denominator.sum()
        rest = [signal[0] / total] * len(self.numerator)
        rest += [-self.static_gain * signal[0] / total] * (len(self.denominator) - 1)
        return np.column_stack(delayed) + np.array(rest)


def _delayed(signal: np.ndarray, lag: int) -> np.ndarray:
    return np.concatenate([np.zeros(lag), signal[: len(signal) - lag]]) if lag else signal


@dataclass(frozen=True, eq=False)
class Curve:
    """A cubic spline through values at knots, straight beyond the first and the last."""

    knots: np.ndarray
    values: np.ndarray

    @cached_property
    def basis(self):
        """Splines that are 1 at one knot and 0 at the others, as one spline with as many values."""
        return scipy.interpolate.CubicSpline(self.knots, np.eye(len(self.knots)), bc_type="natural")

    def design(self, signal: np.ndarray, order: int = 0) -> np.ndarray:
        """What each knot's value adds at a signal, shape (samples, knots), or its derivative by the signal."""
        low, high = self.knots[0], self.knots[-1]
        inside = np.clip(signal, low, high)
        slope = self.basis(inside, 1)
        return slope if order else self.basis(inside) + slope * (signal - inside)[:, None]

    def ascending(self) -> Curve:
        """The same curve with its knots in rising order, whatever sign they were scaled with."""
        order = np.argsort(self.knots)
        return Curve(self.knots[order], self.values[order])

    def apply(self, signal: np.ndarray) -> np.ndarray:
        """The curve at a signal."""
        return self.design(signal) @ self.values

    def slope(self, signal: np.ndarray) -> np.ndarray:
        """Its slope there."""
        return self.design(signal, 1) @ self.values


@dataclass(frozen=True, eq=False)
class BlockStructure(FreeRun):
    """A fitted chain of filter, curve and filter."""

    front: Filter
    curve: Curve
    back: Filter
    sampling_time: float
    """s."""
    train_rms: float = np.nan
    test_rms: float = np.nan
    linear_rms: float = np.nan
    """`train_rms`, `test_rms`: free-run simulation errors in the output's unit; that of the best linear approximation on
    unseen records, each about its mean."""

    @property
    def kind(self) -> str:
        """`WIENER`, `HAMMERSTEIN` or `BOTH`."""
        if self.back.is_static:
            return WIENER
        return HAMMERSTEIN if self.front.is_static else BOTH

    def simulate(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Free-run simulation from rest at the first value, shape (samples,)."""
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.simulate(part) for part in motion.parts])
        return self.back.apply(self.curve.apply(self.front.apply(motion.position)))

    @cached_property
    def vector(self) -> np.ndarray:
        """All coefficients: of the front, of the curve, of the back."""
        parts = [self.front.numerator, self.front.denominator[1:], self.curve.values]
        return np.concatenate([*parts, self.back.numerator, self.back.denominator[1:]])

    def with_vector(self, vector: np.ndarray) -> BlockStructure:
        """The same chain with other coefficients."""
        sizes = [len(self.front.numerator), len(self.front.denominator) - 1, len(self.curve.values)]
        sizes += [len(self.back.numerator)]
        before, under, values, over, behind = np.split(vector, np.cumsum(sizes))
        front = Filter(before, np.concatenate([[1.0], under]))
        return replace(
            self,
            front=front,
            curve=Curve(self.curve.knots, values),
            back=Filter(over, np.concatenate([[1.0], behind])),
        )

    def normalised(self) -> BlockStructure:
        """The same chain with gains of 1 in front and behind: at rest, or at the largest response."""
        front, back = self.front.gain, self.back.gain
        curve = Curve(self.curve.knots / front, self.curve.values * back)
        return replace(
            self, front=self.front.scaled(1 / front), curve=curve.ascending(), back=self.back.scaled(1 / back)
        )

    def to_json(self) -> dict:
        """Return what ``diagnosis.json`` holds under ``chain``; polynomials in rising powers of the delay by a sample."""
        return {
            "kind": self.kind,
            "train_rms": self.train_rms,
            "test_rms": self.test_rms,
            "linear_test_rms": self.linear_rms,
            "sampling_time_s": self.sampling_time,
            "front": self.front.to_json(),
            "curve": {"input": self.curve.knots.tolist(), "output": self.curve.values.tolist()},
            "back": self.back.to_json(),
        }

    def slopes(self, motion: Motion | JoinedMotions) -> np.ndarray:
        """Derivatives of the simulation by `vector`."""
        if isinstance(motion, JoinedMotions):
            return np.concatenate([self.slopes(part) for part in motion.parts])
        inner = self.front.apply(motion.position)
        steep = self.curve.slope(inner)[:, None]
        before = self.back.apply(steep * self.front.slopes(motion.position))
        of_curve = self.back.apply(self.curve.design(inner))
        return np.column_stack([before, of_curve, self.back.slopes(self.curve.apply(inner))])


def block_structure(experiment: Experiment, least_rms: float) -> BlockStructure | None:
    """The chain of fewest filters that explains all records far better than what is known; None where there is none.

    The records must be sampled alike. `least_rms` is the unseen error of the best model so far; the chain must explain more than
    linear approximations do as well.
    """
    training = experiment.training
    steps = [item.motion.sampling_time for one in (training, *experiment.tests) for item in one.records]
    if max(steps) > min(steps) * (1 + 1e-6):
        return None
    short = training if training.size <= _LONG else training.split(_LONG / training.size)[0]
    linear = min(_linear_rms(linear_approximation(short, order), experiment.tests) for order in _ORDERS)
    found = [_judged(_refined(training, item, _LAST_EVALUATIONS), experiment) for item in _chains(short)]
    least = min((item.test_rms for item in found), default=np.inf)
    if not least <= EXPLAINS * min(least_rms, linear):
        return None
    good = [item for item in found if item.test_rms <= _SIMPLER * least]
    chosen = min(good, key=lambda item: (item.kind == BOTH, item.test_rms))
    return replace(chosen.normalised(), linear_rms=linear)


def _linear_rms(model: Filter, records: list[FitData]) -> float:
    """Error of a linear approximation, on every record about its mean."""
    errors = []
    for item in (one for record in records for one in record.records):
        error = item.trim(item.force - model.apply(item.motion.position))
        errors.append(error - error.mean())
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def _judged(chain: BlockStructure, experiment: Experiment) -> BlockStructure:
    return replace(chain, train_rms=chain.rms(experiment.training), test_rms=chain.rms(*experiment.tests))


def _chains(data: FitData) -> list[BlockStructure]:
    """The best chains, one of a kind, on the beginning of a record; none where they are not on the way to explain it.

    The poles of the best chain are nearer to the truth than those of a linear approximation: they are shared out once more.
    """
    linear = [linear_approximation(data, order) for order in _ORDERS]
    least = min(_linear_rms(item, [data]) for item in linear)
    first = _best_of_kinds(data, [_poles_and_zeros(item) for item in linear], 0.0, _ON_THE_WAY * least)
    if not first:
        return []
    best = _finely(data, first[0])
    again = _best_of_kinds(data, [_poles_and_zeros(best.front, best.back)], _NEARLY_REAL, np.inf)
    kinds: dict[str, list[BlockStructure]] = {}
    for chain in (*first, *again):
        kinds.setdefault(chain.kind, []).append(chain)
    chosen = [_finely(data, min(own, key=lambda item: item.rms(data))) for own in kinds.values()]
    errors = [item.rms(data) for item in chosen]
    return [item for item, error in zip(chosen, errors, strict=True) if error <= _PROMISING * min(errors)]


def _finely(data: FitData, chain: BlockStructure) -> BlockStructure:
    """The same chain with as many knots as the result has, refined."""
    knots = _knots(
        np.concatenate([chain.front.apply(part) for part in _split(data, data.motion.position)]), _FINE_KNOTS
    )
    return _refined(data, replace(chain, curve=Curve(knots, chain.curve.apply(knots))), _MORE_EVALUATIONS)


def _best_of_kinds(
    data: FitData, sources: list[tuple[np.ndarray, np.ndarray]], nearly: float, most: float
) -> list[BlockStructure]:
    """For each kind the best way to share out poles and zeros, refined, the best kind first.

    None where none of the first ways that promise most leaves at most an error of `most`; `nearly` as of `_grouped`.
    """
    ways: dict[tuple[int, int], list[BlockStructure]] = {}
    for poles, zeros in sources:
        for front, back in _shared_out(poles, zeros, nearly):
            chain = _with_curve(data, front, back)
            if chain is not None:
                ways.setdefault((front.poles, back.poles), []).append(chain)
    first = sorted((item for tried in ways.values() for item in tried), key=lambda item: item.train_rms)[
        :_TRIED
    ]
    if not any(_refined(data, chain, _EVALUATIONS).rms(data) <= most for chain in first):
        return []
    best: dict[str, BlockStructure] = {}
    for tried in ways.values():
        for chain in sorted(tried, key=lambda item: item.train_rms)[:_REFINED]:
            refined = _refined(data, chain, _EVALUATIONS)
            other = best.setdefault(refined.kind, refined)
            best[refined.kind] = min(refined, other, key=lambda item: item.rms(data))
    return sorted(best.values(), key=lambda item: item.rms(data))


def _shared_out(poles: np.ndarray, zeros: np.ndarray, nearly: float) -> Iterator[tuple[Filter, Filter]]:
    """Filters in front and behind that together have these poles and zeros, in every way."""
    below, above = _grouped(poles, nearly), _grouped(zeros)
    for ahead in product((True, False), repeat=len(below) + len(above)):
        yield tuple(
            Filter(
                _polynomial(
                    [group for group, where in zip(above, ahead[len(below) :], strict=True) if where is side]
                ),
                _polynomial([group for group, where in zip(below, ahead, strict=False) if where is side]),
            )
            for side in (True, False)
        )


def _poles_and_zeros(*filters: Filter) -> tuple[np.ndarray, np.ndarray]:
    """Of filters together, in the plane of the shift operator; a zero far away is a gain within the band."""
    zeros = []
    for item in filters:
        first = np.argmax(np.abs(item.numerator) > _NEGLIGIBLE * np.abs(item.numerator).max())
        zeros.append(np.roots(item.numerator[first:]))
    found = np.concatenate(zeros)
    return np.concatenate([np.roots(item.denominator) for item in filters]), found[np.abs(found) < _FAR]


def linear_approximation(data: FitData, order: int) -> Filter:
    """The best linear approximation of an order, of the records about their means.

    By the iteration of Steiglitz and McBride (IEEE Trans. Automat. Contr. 10 (1965) 461-464), of whose turns the best one counts.
    """
    parts = list(zip(_split(data, data.motion.position), _split(data, data.force), strict=True))
    parts = [[item - item.mean() for item in part] for part in parts]
    best, denominator = (np.inf, np.ones(1), np.ones(1)), np.eye(1, order + 1)[0]
    for _ in range(_TURNS):
        rows = []
        for part in parts:
            motion, answer = (scipy.signal.lfilter([1.0], denominator, item) for item in part)
            lagged = [-_delayed(answer, lag) for lag in range(order + 1)]
            rows.append(np.column_stack([*lagged, *(_delayed(motion, lag) for lag in range(order + 1))]))
        table = data.trim(np.concatenate(rows))
        solution = np.linalg.lstsq(table[:, 1:], -table[:, 0], rcond=None)[0]
        roots = np.roots(np.concatenate([[1.0], solution[:order]]))
        denominator = np.real(np.poly(np.where(np.abs(roots) >= 1, 1 / roots.conj(), roots)))
        errors = [
            scipy.signal.lfilter(solution[order:], denominator, motion) - answer for motion, answer in parts
        ]
        left = float(np.mean(data.trim(np.concatenate(errors)) ** 2))
        if left < best[0]:
            best = (left, solution[order:], denominator)
    return Filter(*best[1:])


def _split(data: FitData, signal: np.ndarray) -> list[np.ndarray]:
    return data.motion.split(signal) if isinstance(data.motion, JoinedMotions) else [signal]


def _grouped(roots: np.ndarray, nearly: float = 0.0) -> list[np.ndarray]:
    """Real roots alone, complex ones as pairs, but for those that lie nearly together."""
    found = [np.array([root.real]) for root in roots if root.imag == 0]
    for root in roots[roots.imag > 0]:
        together = root.imag < nearly * abs(1 - root)
        found += [np.array([root.real])] * 2 if together else [np.array([root, root.conj()])]
    return found


def _polynomial(groups: list[np.ndarray]) -> np.ndarray:
    return np.real(np.poly(np.concatenate(groups))) if groups else np.ones(1)


def _with_curve(data: FitData, front: Filter, back: Filter) -> BlockStructure | None:
    """The curve between two filters by linear least squares, what comes out of the front of size 1."""
    parts = _split(data, data.motion.position)
    inner = [front.apply(part) for part in parts]
    size = float(np.std(np.concatenate(inner)))
    if not np.isfinite(size) or size == 0:
        return None
    inner = [part / size for part in inner]
    front = replace(front, numerator=front.numerator / size)
    knots = _knots(np.concatenate(inner), _KNOTS)
    if len(knots) < _KNOTS:
        return None
    curve = Curve(knots, np.zeros(len(knots)))
    gain = 1 / back.static_gain if abs(back.static_gain) > 1e-9 else 1.0
    back = replace(back, numerator=back.numerator * gain)
    design = np.concatenate([back.apply(curve.design(part)) for part in inner])
    values = np.linalg.lstsq(data.trim(design), data.trim(data.force), rcond=1e-9)[0]
    found = BlockStructure(front, replace(curve, values=values), back, data.motion.sampling_time)
    error = found.rms(data)
    return replace(found, train_rms=error) if np.isfinite(error) else None


def _knots(signal: np.ndarray, count: int) -> np.ndarray:
    """Knots where the signal is: half by its range, half by its quantiles."""
    shares = np.linspace(0.0, 1.0, count)
    ranks = np.quantile(signal, shares)
    return np.unique(0.5 * (ranks + signal.min() + shares * np.ptp(signal)))


def _refined(data: FitData, start: BlockStructure, evaluations: int) -> BlockStructure:
    """All coefficients together, by the simulation error."""
    unit = float(np.linalg.norm(data.whiten(data.force))) or 1.0
    size = np.maximum(np.abs(start.vector), 1e-3)

    @lru_cache(maxsize=1)
    def chain_of(numbers: bytes) -> BlockStructure:
        return start.with_vector(np.frombuffer(numbers) * size)

    def error(vector: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            errors = chain_of(vector.tobytes()).whitened_errors(data) / unit
        return np.nan_to_num(errors, nan=1e3, posinf=1e3, neginf=-1e3).clip(-1e3, 1e3)

    def jacobian(vector: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            slopes = data.whiten(chain_of(vector.tobytes()).slopes(data.motion)) * size / unit
        return np.nan_to_num(slopes)

    found = scipy.optimize.least_squares(
        error,
        start.vector / size,
        jacobian,
        x_scale="jac",
        xtol=1e-8,
        ftol=1e-8,
        gtol=1e-15,
        max_nfev=evaluations,
    )
    refined = start.with_vector(found.x * size)
    with np.errstate(all="ignore"):
        return min(refined, start, key=lambda item: np.nan_to_num(item.rms(data), nan=np.inf))
