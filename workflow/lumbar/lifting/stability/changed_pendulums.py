"""Average cross-sections of changed pendulums: controls of Table 4.1, and contributions of parts to its differences.

Controls: weights, damping, body mass and the sharing of the box are changed one at a time; the sine is replaced by its Taylor
polynomials; in the null control the pendulums are at rest.

Parts: two pendulums differ in duration, length, mass, posture at the start, and the course of the movement. Each part is taken
from one of the two, which gives 32 pendulums and 32 areas. The contribution of a part is its effect on the area, averaged over
all orders in which the parts can be exchanged (Shapley, in Contributions to the Theory of Games II (1953) 307–317); the five
contributions add up to the difference.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import combinations, product
from math import factorial

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels, integrate_backward
from lumbar.lifting.stability.funnel.sum_of_squares import circle_maximum, growth_polynomial
from lumbar.lifting.stability.model.eqs_4_1_to_4_4_closed_loop import (
    Weights,
    close_loops,
    gather,
    regulate,
)
from lumbar.lifting.stability.model.pendulum_trajectories import (
    COMS,
    PLANES,
    Failure,
    Trajectory,
    compute_together,
)
from lumbar.lifting.stability.percent_differences import (
    COMPUTED,
    ComparedLifts,
    comparison_definition,
    headline_label,
)
from lumbar.settings.lifting import StabilitySettings
from lumbar.tables.table import Table, table_from_schema

BODY_MASS_SHARE = 0.1
"""Share by which the body mass of all subjects is increased and decreased."""

_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")
VARIANTS = ("base", *(f"{name}{change}" for name in ("Q", "R", "b") for change in ("/", "*")))
"""Changes: ``base``, and ``Q``, ``R``, ``b`` divided and multiplied by the factor of the configuration."""
TAYLOR = {f"taylor_{degree}": degree for degree in (3, 5, 7)}
"""Degree of the sine's Taylor polynomial by change."""
CHANGES = {
    "lighter": "lighter bodies",
    "heavier": "heavier bodies",
    "box_share": "the box shared the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
    **{name: f"Taylor degree {degree}" for name, degree in TAYLOR.items()},
}
NULL_CONTROL = "null"
"""Name of the areas of the pendulums at rest at θ0 = 0 for the same duration."""


def _change_masses(facts: Mapping, factor: float = 1.0, exchange_share: bool = False) -> dict:
    """Return a lift's facts with the subject's mass times `factor`, or with the other rule for sharing the box.

    Each centre of mass carries the whole box, or a part in proportion to its mass.
    """
    masses, whole = {}, sum(mass["without_box"] for mass in facts["mass_kg"].values())
    for com, mass in facts["mass_kg"].items():
        bare, with_box = mass["without_box"], mass["with_box"] + (factor - 1) * mass["without_box"]
        if exchange_share:
            box, is_shared = float(facts["box_mass_kg"]), facts["box"]["share"] == "by_mass"
            with_box = bare + (box if is_shared else box * bare / whole)
        masses[com] = {"without_box": factor * bare, "with_box": with_box}
    return {**facts, "mass_kg": masses}


OTHER_MASSES = {
    "lighter": partial(_change_masses, factor=1 - BODY_MASS_SHARE),
    "heavier": partial(_change_masses, factor=1 + BODY_MASS_SHARE),
    "box_share": partial(_change_masses, exchange_share=True),
}


def areas_under_changes(study: ComparedLifts) -> tuple[dict[str, pd.DataFrame], list[Failure]]:
    """Return average cross-sections by change of the headline's pendulums, and the failures.

    Each table has the columns ``subject, experience, box_mass_kg, com, plane, mean_area`` (rad²/s).

    Parameters
    ----------
    study : ComparedLifts
        Lifts of the study and their basins.
    """
    settings, trajectories = study.settings, study.trajectories()
    cases = dict.fromkeys((*VARIANTS, *TAYLOR), trajectories) | {
        name: study.trajectories(mass) for name, mass in OTHER_MASSES.items()
    }
    cases[NULL_CONTROL] = [replace(item, angle=np.zeros_like(item.angle)) for item in trajectories]
    # All changes with the true sine together are fastest; only if one has no basin each is computed separately.
    try:
        true_sine = {name: items for name, items in cases.items() if name not in (*TAYLOR, NULL_CONTROL)}
        together = varied_areas(true_sine, settings) if trajectories else {}
    except NumericalError:
        together = {}
    areas: dict[str, pd.DataFrame] = {}
    failures: list[Failure] = []
    for name, items in cases.items():
        if name in TAYLOR:
            compute = partial(taylor_areas, settings=settings, degree=TAYLOR[name])
        else:
            compute = lambda items, name=name: varied_areas({name: items}, settings)[name]  # noqa: E731
        basin = f"Table 4.1, {CHANGES.get(name, 'null control')}"
        computed = [(items, together[name])] if name in together else []
        computed += compute_together(compute, [] if computed else items, basin, failures)
        rows = [
            {key: getattr(item, key) for key in _KEYS} | {"mean_area": area}
            for some, values in computed
            for item, area in zip(some, values, strict=True)
        ]
        areas[name] = pd.DataFrame(rows, columns=[*_KEYS, "mean_area"])
    return areas, failures


def varied_areas(cases: Mapping[str, list[Trajectory]], settings: StabilitySettings) -> dict[str, np.ndarray]:
    """Return average cross-sections (exact method) in rad²/s with Q, R and b changed, shape (trajectories,) per change.

    Parameters
    ----------
    cases : mapping of str to list of Trajectory
        Trajectories by change, one of `VARIANTS`; any other name changes nothing.
    settings : StabilitySettings
        Settings of the study.

    Raises
    ------
    NumericalError
        If a trajectory has no basin.
    """
    counts = [len(items) for items in cases.values()]
    factors = {"/": 1 / settings.sensitivity_factor, "*": settings.sensitivity_factor}
    changes = [{name[0]: factors[name[1]]} if name[1:] in factors else {} for name in cases]
    items = [item for some in cases.values() for item in some]
    scale = {key: np.repeat([change.get(key, 1.0) for change in changes], counts) for key in ("Q", "R", "b")}
    pendulum, base = settings.pendulum, Weights.from_settings(settings.regulator)
    weights = Weights(base.state * scale["Q"][:, None], base.control * scale["R"], base.terminal)
    damping = pendulum.damping_N_m_s * scale["b"]
    pendulums = gather(items, pendulum.sign, damping, pendulum.gravity_m_s2, settings.fewer_knots)
    areas = exact_funnels(regulate(pendulums, weights), settings.goal_level).mean_area
    return dict(zip(cases, np.split(areas, np.cumsum(counts)[:-1]), strict=True))


def taylor_areas(trajectories: list[Trajectory], settings: StabilitySettings, degree: int) -> np.ndarray:
    """Return average cross-sections (exact method) in rad²/s for a Taylor polynomial of the sine, shape (trajectories,).

    Parameters
    ----------
    trajectories : list of Trajectory
        Valid trajectories in the headline's convention.
    settings : StabilitySettings
        Settings of the study.
    degree : int
        Degree of the polynomial.

    Raises
    ------
    NumericalError
        If a basin is not finite with the polynomial.
    """
    fewer = settings.model_copy(update={"knots": settings.fewer_knots})
    loops = close_loops(trajectories, settings.pendulum.sign, fewer)
    goal = np.full(len(trajectories), np.log(settings.goal_level))

    def slope(point, log_level):
        polynomial = growth_polynomial(loops.form(point), np.exp(log_level), degree)
        return circle_maximum(polynomial, degree + 1)

    with np.errstate(over="ignore", invalid="ignore"):
        level = np.exp(integrate_backward(loops, goal, slope))
        areas = Funnels(f"Taylor {degree}", loops.pendulums.duration, loops.cost[::2], level).mean_area
    if not np.isfinite(areas).all():
        index = int(np.argmin(np.isfinite(areas)))
        label = loops.pendulums.labels[index]
        raise NumericalError(f"{label}: no finite basin with Taylor degree {degree}", label)
    return areas


PARTS = ("duration", "length", "mass", "start", "course")
EXCHANGED = [frozenset(taken) for count in range(len(PARTS) + 1) for taken in combinations(PARTS, count)]
"""All sets of parts that can be taken from the second pendulum."""
MAX_PAIRS = 30
"""Largest number of pairs of lifts that are decomposed."""
MIN_PERSONS = 3
"""Least number of subjects on either side for an interval."""


def exchanged(before: Trajectory, after: Trajectory, taken: frozenset[str]) -> Trajectory:
    """Return a pendulum with some parts of another pendulum.

    Parameters
    ----------
    before, after : Trajectory
        Pendulum that is changed; pendulum from which the parts are taken.
    taken : frozenset of str
        Parts, of `PARTS`, taken from `after`.
    """
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
    """Return the contributions of `PARTS` to a difference of areas, shape (..., 5), in percent of the area before the change.

    Parameters
    ----------
    areas : numpy.ndarray, shape (..., 32)
        Average cross-sections in rad²/s, in the order of `EXCHANGED`.
    """
    index = {taken: position for position, taken in enumerate(EXCHANGED)}
    parts = []
    for part in PARTS:
        total = 0.0
        for taken in (taken for taken in EXCHANGED if part not in taken):
            orders = factorial(len(taken)) * factorial(len(PARTS) - 1 - len(taken)) / factorial(len(PARTS))
            total = total + orders * (areas[..., index[taken | {part}]] - areas[..., index[taken]])
        parts.append(100 * total / areas[..., 0])
    return np.stack(parts, axis=-1)


def decomposition_table(study: ComparedLifts) -> tuple[Table, list[Failure]]:
    """Return the contributions to every difference of the headline, and the intermediate pendulums without a basin.

    Parameters
    ----------
    study : ComparedLifts
        Lifts of the study and their basins.
    """
    lifts: dict[tuple, list[Trajectory]] = {}
    for item in study.trajectories():
        lifts.setdefault((item.experience, item.box_mass_kg, item.com, item.plane), []).append(item)
    rows, failures = [], []
    for comparison in study.comparisons:
        for com, plane in product(COMS, PLANES) if comparison.status == COMPUTED else ():
            sides = [lifts.get((*side, com, plane), []) for side in (comparison.before, comparison.after)]
            pairs, areas = [], []
            for pair in _pair_lifts(*sides):
                between = [exchanged(*pair[:2], taken) for taken in EXCHANGED]
                try:
                    areas.append(varied_areas({"parts": between}, study.settings)["parts"])
                    pairs.append(pair)
                except NumericalError as error:
                    failures.append(Failure.from_trajectory(between[0], "Table 4.1, its parts", str(error)))
            if pairs:
                key = {"comparison": comparison.name, "com": com, "plane": plane}
                weights, subjects = (np.array([pair[index] for pair in pairs]) for index in (2, 3))
                rows.append({**key, **_row(weights, subjects, np.array(areas))})
    fields = {"comparison": comparison_definition(study.settings), "headline": headline_label(study.settings)}
    columns = ["comparison", "com", "plane", "percent"]
    columns += [f"{part}{end}_percent" for part in PARTS for end in ("", "_low", "_high")] + ["pairs"]
    frame = pd.DataFrame(rows, columns=columns)
    return table_from_schema(
        "lifting/stability", "table_4_1_parts", frame, study.source_label, fields
    ), failures


def _pair_lifts(before: list[Trajectory], after: list[Trajectory]) -> list[tuple]:
    """Pair the lifts of one subject, or of two subjects; if there are too many pairs, choose them evenly.

    A pair has the lifts before and after, its weight, and the subject of the side with fewer subjects. Equal shares of both sides
    overlap in a pair, so that all lifts of a side have equal weight.
    """
    people = [{item.subject for item in side} for side in (before, after)]
    if shared := people[0] & people[1]:
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
    chosen = np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), MAX_PAIRS)).astype(int))
    return [pairs[index] for index in chosen]


def _row(weights: np.ndarray, subject: np.ndarray, areas: np.ndarray) -> dict[str, float]:
    """Return contributions, and their intervals by leaving out the pairs of each subject in turn.

    Weights and subjects have shape (pairs,); `areas` has shape (pairs, 32), columns in the order of `EXCHANGED`.
    """
    from scipy.stats import t

    whole, subjects = contributions(np.average(areas, axis=0, weights=weights)), np.unique(subject)
    row = {"percent": float(whole.sum()), "pairs": len(areas)}
    ends = np.full((2, len(PARTS)), np.nan)
    if len(subjects) >= MIN_PERSONS:
        # Jackknife: Student's 95 % interval from the contributions without each subject.
        omitted = [np.average(areas, axis=0, weights=weights * (subject != one)) for one in subjects]
        error = np.sqrt((len(subjects) - 1) * np.var(contributions(np.array(omitted)), axis=0))
        half_width = t.ppf(0.975, len(subjects) - 1) * error
        ends = np.array([whole - half_width, whole + half_width])
    for part, value, low, high in zip(PARTS, whole, *ends, strict=True):
        row |= {f"{part}_percent": value, f"{part}_low_percent": low, f"{part}_high_percent": high}
    return row
