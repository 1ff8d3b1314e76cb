"""The dose–response curve of stepping over persons, directions and phases of the movement, from pushes of known size.

A person p steps after a push of size J in direction d at phase φ of the movement with the chance

    λ + (1 − 2λ)/(1 + exp(−(ln J − t_pd − b_d·(φ − ½))/s_d)),    t_p = μ + diag(τ)·L·z_p

with a fixed lapse λ (Wichmann and Hill 2001), z_p standard normal and LLᵀ the correlation of a person's directions. exp(t_pd) is
the threshold: the size after which that person steps in half of all cases at mid-movement. All other unknowns have normal priors
on the scales of `PRIOR`. They are drawn from a t distribution about their mode and weighted; the thresholds of each person are
drawn about theirs and weighted too, which gives the likelihood without them (importance sampling squared: Tran, Scharth, Pitt &
Kohn 2014).
"""

from dataclasses import dataclass

import numpy as np

LAPSE = 0.01
"""Chance of a step that no push explains, and of none whatever the push."""
PRIOR = {"spread": (0.25, 0.7), "width": (0.12, 1.0), "phase": 0.7, "turn": 0.7}
"""τ and s as shares of the threshold: median, and standard deviation of the logarithm; standard deviations about 0 of b and of
what a direction shares with those before it. That of μ about the middle of the range is half the range, or 1."""
DRAWS, OWN_DRAWS, KEPT = (500, 1000, 2000, 2000, 2000, 2000), 12, 2000
ENOUGH = 500
"""Effective draws, after which no more are taken."""
FREEDOM = 3.0
"""Of the t distributions that are drawn from."""
WIDER = 1.15
"""Than the posterior about its mode they are."""
BOUND_STEPS = 8
AT_ONCE = 2**21
"""Chances that are held at once: memory does not grow with draws times pushes."""


@dataclass(frozen=True)
class PushRecords:
    """Pushes done; arrays of shape (pushes,)."""

    persons: tuple[str, ...]
    directions: tuple[str, ...]
    person: np.ndarray
    """Index of the person."""
    direction: np.ndarray
    """Index of the direction."""
    phase: np.ndarray
    """Of the movement when the push begins, from 0 to 1."""
    size: np.ndarray
    """N·s."""
    stepped: np.ndarray
    ranges: np.ndarray
    """Shape (directions, 2): smallest and largest size in N·s that may be given."""
    phases: tuple[float, ...] = (0.5,)
    """At which pushes may be given."""


@dataclass(frozen=True)
class Posterior:
    """Draws of what the pushes leave open, all as likely; the first axis counts draws."""

    log_threshold: np.ndarray
    """Shape (draws, persons, directions): t."""
    mean: np.ndarray
    """Shape (draws, directions), as `phase` and `width`: μ."""
    factor: np.ndarray
    """Shape (draws, directions, directions): diag(τ)·L."""
    phase: np.ndarray
    width: np.ndarray
    effective: float
    """Draws without weights that would tell as much (Kish 1965)."""

    def someone(self, seed: int) -> np.ndarray:
        """Log thresholds of a person who was never pushed, one for each draw; shape (draws, directions)."""
        z = np.random.default_rng([seed, 1]).standard_normal(self.mean.shape)
        return self.mean + np.einsum("sij,sj->si", self.factor, z)


def log_odds(log_size, log_threshold, phase, effect, width) -> np.ndarray:
    """Log odds of a step without lapses; arguments broadcast."""
    return np.clip((log_size - log_threshold - effect * (phase - 0.5)) / width, -500, 500)


def chance(odds) -> np.ndarray:
    """Chance of a step, lapses included."""
    return LAPSE + (1 - 2 * LAPSE) / (1 + np.exp(-odds))


class _Model:
    """The density of many sets of unknowns at once: rows of numbers that are standard normal a priori."""

    def __init__(self, records: PushRecords):
        self.people, self.ways = len(records.persons), len(records.directions)
        cell = records.person * self.ways + records.direction
        order = np.argsort(cell, kind="stable")
        self.cell, self.way = cell[order], records.direction[order]
        self.filled, self.starts = np.unique(self.cell, return_index=True)
        self.log_size, self.later = np.log(records.size)[order], records.phase[order]
        self.stepped = records.stepped[order]
        low, high = np.log(records.ranges.T)
        self.centre, self.reach = (low + high) / 2, np.maximum(1.0, (high - low) / 2)
        self.unknowns = 4 * self.ways + self.ways * (self.ways - 1) // 2

    def parts(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """μ, diag(τ)·L, b and s of unknowns of shape (n, unknowns)."""
        level, spread, effect, width, turns = np.split(np.clip(x, -6, 6), self.ways * np.arange(1, 5), axis=1)
        (middle, scatter), (steep, doubt) = PRIOR["spread"], PRIOR["width"]
        tau, s = middle * np.exp(scatter * spread), steep * np.exp(doubt * width)
        factor = np.repeat(np.eye(self.ways)[None], len(x), axis=0)
        factor[:, *np.tril_indices(self.ways, -1)] = PRIOR["turn"] * turns
        factor *= (tau / np.linalg.norm(factor, axis=2))[:, :, None]
        return self.centre + self.reach * level, factor, PRIOR["phase"] * effect, s

    def odds(self, t: np.ndarray, effect: np.ndarray, width: np.ndarray) -> np.ndarray:
        """Log odds of every push, shape (n, pushes), for t of shape (n, persons, directions)."""
        own = t.reshape(len(t), -1)[:, self.cell]
        return log_odds(self.log_size, own, self.later, effect[:, self.way], width[:, self.way])

    def by_threshold(self, values: np.ndarray) -> np.ndarray:
        """Sums over the pushes of each person and direction, shape (n, persons, directions)."""
        found = np.zeros((len(values), self.people * self.ways))
        if len(self.cell):
            found[:, self.filled] = np.add.reduceat(values, self.starts, axis=1)
        return found.reshape(len(values), self.people, self.ways)

    def joint(self, t: np.ndarray, mean, factor, effect, width) -> np.ndarray:
        """Log density of every person's pushes and t, shape (n, persons), without its constant."""
        odds = self.odds(t, effect, width)
        likelihood = self.by_threshold(np.log(chance(np.where(self.stepped, odds, -odds)))).sum(axis=2)
        z = np.linalg.solve(factor, (t - mean[:, None]).swapaxes(1, 2))
        volume = np.log(np.einsum("nii->ni", factor)).sum(axis=1)
        return likelihood - 0.5 * (z**2).sum(axis=1) - volume[:, None]

    def about(self, mean, factor, effect, width) -> tuple[np.ndarray, np.ndarray]:
        """About the mode and precision of every person's t given the unknowns, without lapses.

        Each step goes to the top of the parabola that touches the logistic likelihood from below: from afar none overshoots.
        """
        inverse, s, each = np.linalg.inv(factor), width[:, self.way], np.eye(self.ways)
        prior = (inverse.swapaxes(1, 2) @ inverse)[:, None]
        t = np.repeat(mean[:, None], self.people, axis=1)
        for _ in range(BOUND_STEPS):
            odds = self.odds(t, effect, width)
            odds = np.where(np.abs(odds) < 1e-6, 1e-6, odds)
            bare = 1 / (1 + np.exp(-odds))
            curvature = self.by_threshold((bare - 0.5) / odds / s**2)
            pull = self.by_threshold((bare - self.stepped) / s)[..., None]
            pull -= prior @ (t - mean[:, None])[..., None]
            t = t + np.linalg.solve(prior + curvature[..., None] * each, pull)[..., 0]
        return t, prior + self.by_threshold(bare * (1 - bare) / s**2)[..., None] * each

    def laplace(self, x: np.ndarray) -> np.ndarray:
        """Log density of unknowns given the pushes by Laplace's method, shape (n,), without its constant."""
        t, precision = self.about(*self.parts(x))
        inner = self.joint(t, *self.parts(x)) - 0.5 * np.linalg.slogdet(precision)[1]
        return inner.sum(axis=1) - 0.5 * (x**2).sum(axis=1)

    def sampled(self, x: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Log density of unknowns given the pushes by draws of t, shape (n,), and one of these draws for every person."""
        mode, precision = self.about(*self.parts(x))
        root = WIDER * np.linalg.cholesky(np.linalg.inv(precision))
        z, less = _students(rng, (OWN_DRAWS, len(x), self.people), self.ways)
        t = mode + (root @ z[..., None])[..., 0]
        weights = np.stack([self.joint(own, *self.parts(x)) for own in t]) - less
        top = weights.max(axis=0)
        share = np.cumsum(np.exp(weights - top), axis=0)
        chosen = (share < share[-1] * rng.random(top.shape)).sum(axis=0)
        inner = top + np.log(share[-1]) + np.linalg.slogdet(root)[1]
        taken = np.take_along_axis(t, chosen[None, ..., None], axis=0)[0]
        return inner.sum(axis=1) - 0.5 * (x**2).sum(axis=1), taken


def _students(rng: np.random.Generator, shape: tuple, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws of the t distribution, shape (*shape, dimensions), and their log density without its constant."""
    z = rng.standard_normal((*shape, dimensions))
    z /= np.sqrt(rng.chisquare(FREEDOM, shape) / FREEDOM)[..., None]
    return z, -0.5 * (FREEDOM + dimensions) * np.log1p((z**2).sum(axis=-1) / FREEDOM)


def _mode(model: _Model) -> tuple[np.ndarray, np.ndarray]:
    """Mode of the unknowns, and about their covariance there."""
    from scipy.optimize import minimize

    each = 1e-3 * np.eye(model.unknowns)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        found = model.laplace(np.vstack([x, x + each, x - each]))
        after, before = np.split(found[1:], 2)
        return -found[0], (before - after) / 2e-3

    found = minimize(loss, np.zeros(model.unknowns), jac=True, method="BFGS", options={"gtol": 1e-2})
    return found.x, found.hess_inv


def posterior_of(records: PushRecords, seed: int) -> Posterior:
    """Draw thresholds, curve and population, given all pushes done; none leaves the priors."""
    model, rng = _Model(records), np.random.default_rng(seed)
    centre, covariance = _mode(model)
    at_once = max(1, AT_ONCE // max(1, len(records.size)))
    best: tuple = (0.0,)
    for count in DRAWS:
        z, density = _students(rng, (count,), model.unknowns)
        x = centre + WIDER * z @ np.linalg.cholesky(covariance).T
        found = [model.sampled(x[start : start + at_once], rng) for start in range(0, count, at_once)]
        likely, t = (np.concatenate(item) for item in zip(*found, strict=True))
        weight = np.exp(likely - density - (likely - density).max())
        weight = np.minimum(weight, weight.mean() * np.sqrt(count))  # no draw stands for many (Ionides 2008)
        weight /= weight.sum()
        effective = float(1 / (weight**2).sum())
        best = max(best, (effective, weight, x, t), key=lambda item: item[0])
        if effective > ENOUGH:
            break
        learnt = weight @ x
        own = (x - learnt).T @ ((x - learnt) * weight[:, None])
        known = effective / (effective + model.unknowns**2)
        centre, covariance = learnt, known * own + (1 - known) * covariance
    effective, weight, x, t = best
    chosen = np.searchsorted(np.cumsum(weight), (np.arange(KEPT) + rng.random()) / KEPT)
    chosen = np.minimum(chosen, len(weight) - 1)
    return Posterior(t[chosen], *model.parts(x[chosen]), effective)
