"""The controls of Table 4.1: what its headline rests on, a row per difference.

Share that comes from the movement, the null control, the range when weights, damping, body mass and the sharing of the box are
changed one at a time, and a sentence that says whether the difference survives this.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
import pandas as pd

from lumbar.base.errors import NumericalError
from lumbar.lifting.measures.compare_groups import Difference, compare_means
from lumbar.lifting.stability.comparison.percent_differences import (
    Study,
    comparison_definition,
    comparisons,
    headline_words,
    regulator_sentence,
)
from lumbar.lifting.stability.funnel.exact_funnel import Funnels, exact_funnels, integrate_backward
from lumbar.lifting.stability.model.eq_4_1_pendulum import gather
from lumbar.lifting.stability.model.eq_4_2_regulator import Weights, close_loops, regulate
from lumbar.lifting.stability.model.failures import compute_together
from lumbar.lifting.stability.model.trajectories import PLANES, THESIS, Failure, Trajectory, at_rest
from lumbar.lifting.stability.programme.polynomials import circle_maximum, growth_polynomial
from lumbar.settings.stability import StabilitySettings
from lumbar.tables.described import columns_of, described
from lumbar.tables.table import Table

MOVEMENT_SHARE = 0.5
"""Share of a difference that must come from the movement, and not from duration, mass and length, for it to survive."""
BODY_MASS_SHARE = 0.1
"""By how much of it everybody's body mass is raised and lowered."""

_KEYS = ("subject", "experience", "box_mass_kg", "com", "plane")
VARIANTS = ("base", *(f"{name}{change}" for name in ("Q", "R", "b") for change in ("/", "*")))
"""``base``, and ``Q``, ``R``, ``b`` divided and multiplied by the factor of the configuration."""
TAYLOR = {f"taylor_{degree}": degree for degree in (3, 5, 7)}
"""Degree of the sine's polynomial by change."""
CHANGES = {
    "lighter": "lighter bodies",
    "heavier": "heavier bodies",
    "box_share": "the box shared the other way",
    **{f"{name}/": f"{name} divided" for name in ("Q", "R", "b")},
    **{f"{name}*": f"{name} multiplied" for name in ("Q", "R", "b")},
    **{name: f"Taylor degree {degree}" for name, degree in TAYLOR.items()},
}
NULL_CONTROL = "null"
"""Name of the areas of the same pendulums standing still at θ0 = 0."""


def _body_mass(facts: Mapping, factor: float) -> dict:
    """Change the masses of a lift's facts as if everybody weighed `factor` times as much."""
    masses = {
        com: {"without_box": factor * own["without_box"]}
        | {"with_box": own["with_box"] + (factor - 1) * own["without_box"]}
        for com, own in facts["mass_kg"].items()
    }
    return {**facts, "mass_kg": masses}


def _box_share(facts: Mapping) -> dict:
    """Share the box the other way: whole to every centre of mass instead of in proportion, or the reverse."""
    box = float(facts["box_mass_kg"])
    own = {com: item["without_box"] for com, item in facts["mass_kg"].items()}
    whole = facts["box"]["share"] == "by_mass"
    masses = {
        com: {"without_box": mass, "with_box": mass + (box if whole else box * mass / sum(own.values()))}
        for com, mass in own.items()
    }
    return {**facts, "mass_kg": masses}


OTHER_MASSES = {
    "lighter": partial(_body_mass, factor=1 - BODY_MASS_SHARE),
    "heavier": partial(_body_mass, factor=1 + BODY_MASS_SHARE),
    "box_share": _box_share,
}


def variants(study: Study) -> tuple[dict[str, pd.DataFrame], list[Failure]]:
    """Return average cross-sections under every change that the headline is examined with.

    The areas by change have columns ``subject, experience, box_mass_kg, com, plane, mean_area``. Areas that could not
    be computed have no row; they are the failures.
    """
    settings, trajectories = study.settings, study.trajectories()
    cases = dict.fromkeys((*VARIANTS, *TAYLOR), trajectories) | {
        name: study.trajectories(mass) for name, mass in OTHER_MASSES.items()
    }
    cases[NULL_CONTROL] = [at_rest(item) for item in trajectories]
    # All changes with the true sine at once are fastest; only where one has no basin is each computed by itself.
    try:
        true_sine = {name: items for name, items in cases.items() if name not in (*TAYLOR, NULL_CONTROL)}
        at_once = varied_areas(true_sine, settings) if trajectories else {}
    except NumericalError:
        at_once = {}
    areas: dict[str, pd.DataFrame] = {}
    failures: list[Failure] = []
    for name, items in cases.items():
        found = list(zip(items, at_once[name], strict=True)) if name in at_once else []
        left = [] if name in at_once else items
        compute = partial(_areas_under, name, settings)
        basin = f"Table 4.1, {CHANGES.get(name, 'null control')}"
        for some, values in compute_together(compute, left, basin, failures):
            found += zip(some, values, strict=True)
        rows = [{key: getattr(item, key) for key in _KEYS} | {"mean_area": area} for item, area in found]
        areas[name] = pd.DataFrame(rows, columns=[*_KEYS, "mean_area"])
    return areas, failures


def _areas_under(name: str, settings: StabilitySettings, items: list[Trajectory]) -> np.ndarray:
    if name in TAYLOR:
        return taylor_areas(items, settings, TAYLOR[name])
    return varied_areas({name: items}, settings)[name]


def varied_areas(cases: Mapping[str, list[Trajectory]], settings: StabilitySettings) -> dict[str, np.ndarray]:
    """Average cross-sections (exact method) with Q, R and b changed, all at once.

    The areas are given by change, shape (trajectories,). A key of `cases` that is one of `VARIANTS` gets that change;
    under any other name the trajectories stay as they are.

    Raises
    ------
    NumericalError
        One of them has no basin.
    """
    counts = [len(own) for own in cases.values()]
    factors = {"/": 1 / settings.sensitivity_factor, "*": settings.sensitivity_factor}
    changes = [{name[0]: factors[name[1]]} if name[1:] in factors else {} for name in cases]
    items = [item for own in cases.values() for item in own]
    scale = {
        quantity: np.repeat([change.get(quantity, 1.0) for change in changes], counts)
        for quantity in ("Q", "R", "b")
    }
    pendulum, base = settings.pendulum, Weights.of(settings.regulator)
    weights = Weights(base.state * scale["Q"][:, None], base.control * scale["R"], base.terminal)
    damping = pendulum.damping_N_m_s * scale["b"]
    pendulums = gather(items, pendulum.sign, damping, pendulum.gravity_m_s2, settings.fewer_knots)
    areas = exact_funnels(regulate(pendulums, weights), settings.goal_level).mean_area
    return dict(zip(cases, np.split(areas, np.cumsum(counts)[:-1]), strict=True))


def taylor_areas(trajectories: list[Trajectory], settings: StabilitySettings, degree: int) -> np.ndarray:
    """Average cross-sections (exact method) with the sine replaced by its Taylor polynomial of a degree.

    Raises
    ------
    NumericalError
        The polynomial has no basin that is finite.
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


def controls_table(
    study: Study,
    differences: dict[str, list[dict]],
    areas: pd.DataFrame,
    parts: pd.DataFrame,
) -> Table:
    """Return what stands behind the headline: a row per comparison, centre of mass and plane.

    Parameters
    ----------
    differences : dict of str to list of dict
        Of `percent_differences`, row by row alike: ``headline``, its sections ``initial`` and ``minimum``, its null control
        and every change.
    areas : pandas.DataFrame
        Of the headline.
    parts : pandas.DataFrame
        Of `decomposition.decomposition_table`.
    """
    settings = study.settings
    sides = list(comparisons(study.people, settings.compare.groups))
    own = parts.set_index(["comparison", "com", "plane"])
    shares = (own["start_percent"] + own["course_percent"]) / own["percent"]
    rows = []
    for plane in PLANES:
        for index, row in enumerate(differences["headline"]):
            key = row["comparison"], row["com"]
            found = {name: rows_of[index][plane] for name, rows_of in differences.items()}
            percents = {name: None if np.isnan(value) else value for name, value in found.items()}
            entry = {"comparison": row["comparison"], "com": row["com"], "plane": plane}
            entry["movement_share"] = share = shares.get((*key, plane))
            entry |= _controls(percents)
            persons = _difference(areas, sides, row, plane)
            entry["verdict"] = _verdict(row["status"], share, percents, persons)
            rows.append(entry)
    frame = pd.DataFrame(rows)
    numbers = [name for name in frame.columns if name.endswith("percent") or name == "movement_share"]
    frame = frame.astype(dict.fromkeys(numbers, float))[columns_of("lifting/stability", "table_4_1_controls")]
    words = {
        "thesis": THESIS,
        "comparison": comparison_definition(settings),
        "headline": headline_words(settings),
        "factor": settings.sensitivity_factor,
        "body": 100 * BODY_MASS_SHARE,
    }
    notes = (regulator_sentence(settings),)
    return described("lifting/stability", "table_4_1_controls", frame, study.source_label, words, notes=notes)


def _controls(percents: dict[str, float | None]) -> dict[str, float | None]:
    """Numbers of one row: the headline's, its null control, and the range under all changes."""
    percent = percents["headline"]
    under_changes = [percents[name] for name in percents if name in CHANGES]
    spread = [value for value in (percent, *under_changes) if value is not None]
    return {
        "percent": percent,
        "initial_percent": percents["initial"],
        "minimum_percent": percents["minimum"],
        "null_percent": percents[NULL_CONTROL],
        "thesis_percent": percents["thesis"],
        "lowest_percent": min(spread, default=None),
        "highest_percent": max(spread, default=None),
    }


def _verdict(status: str, share: float | None, percents: dict[str, float | None], persons: Difference) -> str:
    percent = percents["headline"]
    if status.startswith("no basin") and percent is None:
        return status
    changed = {words: percents[name] for name, words in CHANGES.items() if name in percents}
    return verdict(percent, share, changed, persons)


def verdict(
    percent: float | None, movement: float | None, changed: dict[str, float | None], persons: Difference
) -> str:
    """Return the sentence on a percentage, None where the study cannot tell.

    `movement` is the share that comes from the posture at the start and the course, None where that is not known; `changed` has
    the percentage under each change, by its name; `persons` is the difference over persons. Its interval is given in percent of
    the mean that is compared with.
    """
    if percent is None:
        return "not testable in this study"
    turned = [name for name, value in changed.items() if value is not None and value * percent <= 0]
    reasons = []
    if turned:
        reasons.append(f"its sign turns with {', '.join(turned)}")
    if movement is not None and movement < MOVEMENT_SHARE:
        reasons.append(f"{100 * (1 - movement):.0f} % of it come from duration, mass and length")
    unknown = [name for name, value in changed.items() if value is None]
    if movement is None:
        unknown.append("its parts exchanged")
    if unknown:
        reasons.append(f"no basin with {', '.join(unknown)}")
    certainty = persons.remark
    if persons.low is not None and persons.high is not None:
        if persons.low <= 0 <= persons.high:
            reasons.append("its interval over persons contains 0")
        low, high = (100 * end / persons.second for end in (persons.low, persons.high))
        certainty = f"95 % interval over persons [{low:+.2f}, {high:+.2f}] %"
    if reasons:
        return f"does not survive: {'; '.join(reasons)} ({certainty})"
    return f"survives parts and sensitivity ({certainty})"


def _difference(areas: pd.DataFrame, compared_sides: list[tuple], row: dict, plane: str) -> Difference:
    """Compare the areas behind one percentage over persons, or say why there is no interval."""
    found = {name: (before, after) for name, before, after, _ in compared_sides}
    before, after = found[row["comparison"]]
    if before is None:
        return Difference(np.nan, np.nan, (0, 0), remark="nothing to compare")
    here = areas[(areas["com"] == row["com"]) & (areas["plane"] == plane)]
    sides = [
        here[(here["experience"] == experience) & (here["box_mass_kg"] == mass)]
        .groupby("subject")["mean_area"]
        .mean()
        for experience, mass in (after, before)
    ]
    return compare_means(*sides, paired=before[0] == after[0], names=(after[0], before[0]))
