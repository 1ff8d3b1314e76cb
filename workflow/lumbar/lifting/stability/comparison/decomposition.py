"""What each difference of Table 4.1 comes from: duration, length, mass, posture at the start, and the course of the movement.

Two pendulums differ in these five parts. Any of them may be taken from the one and the rest from the other, which makes 32
pendulums and as many areas. A part's contribution is what it adds to the area, averaged over all orders in which the parts can be
exchanged (Shapley, in Contributions to the Theory of Games II (1953) 307–317): the five add up to the difference.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from math import factorial

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.comparison.percent_differences import (
    Study,
    comparison_definition,
    comparisons,
    headline_words,
)
from lumbar.lifting.stability.comparison.table_4_1_controls import varied_areas
from lumbar.lifting.stability.model.trajectories import COMS, PLANES, Failure, Trajectory
from lumbar.tables.described import described
from lumbar.tables.table import Table

PARTS = ("duration", "length", "mass", "start", "course")
EXCHANGED = [frozenset(taken) for count in range(len(PARTS) + 1) for taken in combinations(PARTS, count)]
"""Every choice of parts that are taken from the pendulum after."""
MOST_PAIRS = 30
FEWEST_PERSONS = 3
"""Pairs of lifts that are decomposed at most, and persons of either side that an interval needs."""


def exchanged(before: Trajectory, after: Trajectory, taken: frozenset[str]) -> Trajectory:
    """Return the pendulum before with some parts of the one after."""
    of = {part: after if part in taken else before for part in PARTS}
    course, faster = of["course"], of["course"].duration / of["duration"].duration
    return replace(
        before,
        time=(course.time - course.time[0]) / faster,
        angle=of["start"].angle[0] + course.angle - course.angle[0],
        angular_velocity=course.angular_velocity * faster,
        angular_acceleration=course.angular_acceleration * faster**2,
        mass_kg=of["mass"].mass_kg,
        length_m=of["length"].length_m,
    )


def contributions(areas: np.ndarray) -> np.ndarray:
    """Return what each of `PARTS` adds, in percent of the area before; `areas`, shape (..., 32), are by `EXCHANGED`."""
    index = {taken: position for position, taken in enumerate(EXCHANGED)}
    found = []
    for part in PARTS:
        total = 0.0
        for taken in EXCHANGED:
            if part not in taken:
                others = len(PARTS) - 1 - len(taken)
                weight = factorial(len(taken)) * factorial(others) / factorial(len(PARTS))
                total = total + weight * (areas[..., index[taken | {part}]] - areas[..., index[taken]])
        found.append(100 * total / areas[..., 0])
    return np.stack(found, axis=-1)


def jackknife_interval(value: np.ndarray, left_out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Student's 95 % interval of an estimate from those without each person, shape (persons, ...)."""
    from scipy.stats import t

    count = len(left_out)
    error = np.sqrt((count - 1) * np.var(left_out, axis=0))
    reach = t.ppf(0.975, count - 1) * error
    return value - reach, value + reach


def decomposition_table(study: Study) -> tuple[Table, list[Failure]]:
    """Return the contributions to every difference of the headline, and the pendulums between that have no basin."""
    lifts: dict[tuple, list[Trajectory]] = {}
    for item in study.trajectories():
        lifts.setdefault((item.experience, item.box_mass_kg, item.com, item.plane), []).append(item)
    rows, failures = [], []
    for name, before, after, status in comparisons(study.people, study.settings.compare.groups):
        for com in COMS if status == "computed" else ():
            for plane in PLANES:
                pairs = _pairs(*(lifts.get((*side, com, plane), []) for side in (before, after)))
                areas = _areas(pairs, study, failures)
                if areas:
                    rows.append({"comparison": name, "com": com, "plane": plane, **_row(areas)})
    words = {"comparison": comparison_definition(study.settings), "headline": headline_words(study.settings)}
    columns = ["comparison", "com", "plane", "percent"]
    columns += [f"{part}{end}_percent" for part in PARTS for end in ("", "_low", "_high")] + ["pairs"]
    frame = pd.DataFrame(rows, columns=columns)
    return described("lifting/stability", "table_4_1_parts", frame, study.source_label, words), failures


def _pairs(
    before: list[Trajectory], after: list[Trajectory]
) -> list[tuple[Trajectory, Trajectory, int, str]]:
    """Pair the lifts of one person, or person by person; evenly chosen where there are many.

    The pairs are where equal shares of both sides overlap, so that every lift of a side weighs alike, however many the other has.
    Returned are before, after, weight and person: of both lifts, or of the side with fewer persons.
    """
    people = [{item.subject for item in side} for side in (before, after)]
    shared = people[0] & people[1]
    if shared:
        before, after = (
            sorted((item for item in side if item.subject in shared), key=lambda item: item.subject)
            for side in (before, after)
        )
    fewer = int(len(people[1]) < len(people[0]))
    first, second = len(before), len(after)
    if not first * second:
        return []
    starts = np.union1d(np.arange(first) * second, np.arange(second) * first)
    pairs = []
    for start, weight in zip(starts, np.diff(starts, append=first * second), strict=True):
        lifts = before[start // second], after[start // first]
        pairs.append((*lifts, int(weight), lifts[fewer].subject))
    return [
        pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), MOST_PAIRS)).astype(int))
    ]


def _areas(pairs: list, study: Study, failures: list[Failure]) -> list[tuple[np.ndarray, int, str]]:
    """Areas of all that lies between, shape (32,), weight and person of each pair; without pairs in which a basin is missing."""
    found = []
    for *lifts, weight, person in pairs:
        between = [exchanged(*lifts, taken) for taken in EXCHANGED]
        try:
            areas = varied_areas({"parts": between}, study.settings)["parts"]
        except NumericalError as error:
            failures.append(Failure.of(between[0], "Table 4.1, its parts", str(error)))
        else:
            found.append((areas, weight, person))
    return found


def _row(found: list[tuple[np.ndarray, int, str]]) -> Mapping[str, float]:
    """Contributions, and their intervals from leaving out one person's pairs after the other."""
    areas, weight, person = map(np.array, zip(*found, strict=True))
    whole, persons = contributions(np.average(areas, axis=0, weights=weight)), np.unique(person)
    row = {"percent": float(whole.sum()), "pairs": len(areas)}
    ends = np.full((2, len(PARTS)), np.nan)
    if len(persons) >= FEWEST_PERSONS:
        left_out = [np.average(areas, axis=0, weights=weight * (person != one)) for one in persons]
        ends = np.array(jackknife_interval(whole, contributions(np.array(left_out))))
    for part, value, low, high in zip(PARTS, whole, *ends, strict=True):
        row |= {f"{part}_percent": value, f"{part}_low_percent": low, f"{part}_high_percent": high}
    return row
