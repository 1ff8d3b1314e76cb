"""Groups of people drawn at random, with a known scatter between people and between one person's trials."""

from collections.abc import Sequence

import numpy as np

from lumbar.lifting.population.variance_components import PersonMeans

UNEQUAL = "1 to 5"
"""Numbers of trials drawn for every person by itself."""


def draw_group(
    rng: np.random.Generator,
    persons: int,
    trials: int | str,
    correlation: float,
    mean: float = 0.0,
    scale: float = 1.0,
    skewed: bool = False,
) -> PersonMeans:
    """Draw a group whose values have the variance scale², of which `correlation` (intraclass) is between people.

    `trials` of each person, or `UNEQUAL`; `skewed`: people spread as exponential variables do (skewness 2), not normally.
    """
    counts = rng.integers(1, 6, persons) if trials == UNEQUAL else [trials] * persons
    people = (rng.exponential(1, persons) - 1) if skewed else rng.normal(0, 1, persons)
    middles = mean + scale * np.sqrt(correlation) * people
    spread = scale * np.sqrt(1 - correlation)
    return PersonMeans.of(
        {
            f"p{number}": middle + spread * rng.normal(0, 1, count)
            for number, (middle, count) in enumerate(zip(middles, counts, strict=True))
        }
    )


def draw_pair(
    rng: np.random.Generator, persons: int, trials: int | str, correlation: float, means: Sequence[float]
) -> tuple[PersonMeans, PersonMeans]:
    """Draw the same persons under two conditions, to which they respond differently."""
    levels = rng.normal(0, 2, persons)
    sides = [draw_group(rng, persons, trials, correlation, mean) for mean in means]
    first, second = (
        PersonMeans(
            side.persons, tuple(values + level for values, level in zip(side.values, levels, strict=True))
        )
        for side in sides
    )
    return first, second
