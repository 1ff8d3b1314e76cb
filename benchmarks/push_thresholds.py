"""Thresholds of stepping: do 95 % intervals cover, how many pushes does a design need, and what where the model is wrong?

    python benchmarks/push_thresholds.py [--cohorts 20] [--persons 20] [--only designs] [--markdown PAGE]

Simulates persons with known thresholds, lets the library estimate them, and prints three tables: coverage, width and calibration
where the model holds and where it does not; pushes until both thresholds of a person are known to a width, by design; and the
simulated bodies of `lumbar.lifting.pushes`, whose thresholds bisection tells. The target of coverage is 93 to 97 %.
With ``--markdown`` the first two go into docs/lifting/push_experiment.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import one_thread  # noqa: F401 # isort: skip

import numpy as np
import pandas as pd
from lifting_cases import deposit
from scipy.special import expit, ndtr

from acceptance_page import show_section
from lumbar.lifting.pushes.contest import scene_of
from lumbar.lifting.pushes.dose_response import PushRecords, posterior_of
from lumbar.lifting.pushes.push_design import next_push
from lumbar.lifting.pushes.simulation import Pushes, draw_traits, simulate
from lumbar.lifting.pushes.threshold_tables import predicted, trends
from lumbar.settings.pushes import PushesSettings

WAYS = ("forward", "backward")
RANGES = np.array([[2.0, 30.0], [10.0, 80.0]])
PHASES = (0.25, 0.5, 0.75)
MIDDLES = np.log([9.0, 35.0])
KINDS = (
    "as modelled",
    "probit",
    "3 % lapses",
    "no scatter",
    "persons of heavy tails",
    "thresholds rise by 30 %",
)
DESIGNS = ("next push", "next push, any size", "staircase", "random")
ACCURACIES = (30, 25, 20)
"""Half-widths in % until which a person is pushed; of intervals of ln threshold, means of both directions."""
MOST = 96
LOOKED_AT = (*range(4, 24), *range(24, MOST + 1, 4))


class People:
    """Persons with known thresholds, and the curve that they share."""

    def __init__(self, rng: np.random.Generator, count: int, kind: str = KINDS[0]):
        self.rng, self.kind = rng, kind
        spread, correlation = rng.uniform(0.15, 0.4), rng.uniform(-0.3, 0.8)
        root = spread * np.linalg.cholesky([[1, correlation], [correlation, 1]])
        z = rng.standard_normal((count, 2))
        if kind == KINDS[4]:
            z = rng.standard_t(3, (count, 2)) / np.sqrt(3)
        self.t = MIDDLES + z @ root.T
        self.width = 1e-3 if kind == KINDS[3] else np.exp(rng.uniform(np.log(0.06), np.log(0.25)))
        self.effect = rng.normal(0, 0.3, 2)

    def step(self, person, way, phase, size, session) -> np.ndarray:
        """Draw outcomes; `session` is the share of the person's pushes that are done."""
        t = self.t[person, way] + (np.log(1.3) * (session - 0.5) if self.kind == KINDS[5] else 0)
        odds = (np.log(size) - t - self.effect[way] * (phase - 0.5)) / self.width
        chance = ndtr(odds / 1.702) if self.kind == KINDS[1] else expit(odds)
        if self.kind == KINDS[2]:
            chance = 0.03 + 0.94 * chance
        return self.rng.random(np.shape(chance)) < chance


def records(persons: int, rows, phases=PHASES) -> PushRecords:
    """Pushes of columns person, way, phase, size, stepped."""
    person, way, phase, size, stepped = (
        np.array(item) for item in (zip(*rows, strict=True) if rows else [()] * 5)
    )
    names = tuple(map(str, range(persons)))
    return PushRecords(
        names, WAYS, person.astype(int), way.astype(int), phase.astype(float), size.astype(float),
        stepped.astype(bool), RANGES, phases,
    )  # fmt: skip


def random_rows(people: People, pushes: int) -> list[tuple]:
    """Pushes of sizes evenly likely, directions in turn, one person after the other."""
    rng, count = people.rng, len(people.t)
    person, number = np.repeat(np.arange(count), pushes), np.tile(np.arange(pushes), count)
    way, phase = number % 2, rng.random(count * pushes)
    size = RANGES[way, 0] + rng.random(len(way)) * np.ptp(RANGES, axis=1)[way]
    return list(
        zip(person, way, phase, size, people.step(person, way, phase, size, number / pushes), strict=True)
    )


def ends_of(posterior, person) -> np.ndarray:
    """Ends of the 95 % interval and median of ln threshold, shape (3, directions)."""
    return np.quantile(posterior.log_threshold[:, person], [0.025, 0.975, 0.5], axis=0)


def coverage(cohorts: int) -> pd.DataFrame:
    """Coverage, width and calibration over cohorts, by kind of truth and size."""
    rows = []
    plans = [(KINDS[0], 1, 24), (KINDS[0], 5, 12), (KINDS[0], 20, 24), *((kind, 10, 24) for kind in KINDS)]
    for kind, persons, pushes in plans:
        held, width, drifts, told, stepped = [], [], [], [], []
        for seed in range(cohorts * 5 if persons == 1 else cohorts):
            people = People(np.random.default_rng([seed, 1]), persons, kind)
            done = records(persons, random_rows(people, pushes))
            posterior = posterior_of(done, seed)
            low, high, _ = np.quantile(posterior.log_threshold, [0.025, 0.975, 0.5], axis=0)
            held.append(((low <= people.t) & (people.t <= high)).mean())
            width.append((high - low).mean())
            told.append(predicted(done, posterior))
            stepped.append(done.stepped)
            drifts.append(np.abs(trends(done, told[-1])) > 2.58)
        chance, outcome = np.concatenate(told), np.concatenate(stepped)
        bands = [(chance >= low) & (chance < low + 0.2) for low in np.arange(0, 1, 0.2)]
        off = [abs(chance[band].mean() - outcome[band].mean()) for band in bands if band.any()]
        error = np.std(held) / np.sqrt(len(held))
        rows.append((kind, persons, pushes, len(held) * persons, 100 * np.mean(held), 100 * error,
                     np.mean(width), 100 * max(off), *100 * np.mean(drifts, axis=0)))  # fmt: skip
        print(
            *(f"{item:.3g}" if isinstance(item, float) else item for item in rows[-1]), sep="  ", flush=True
        )
    columns = [
        "truth",
        "persons",
        "pushes of each",
        "simulated",
        "covered %",
        "±",
        "width",
        "calibration off by %",
    ]
    return pd.DataFrame(rows, columns=[*columns, "drift told %", "bend told %"])


def session(design: str, seed: int) -> dict[str, float]:
    """Push a new person at mid-movement: pushes until each of `ACCURACIES`, and steps and coverage then."""
    people = People(np.random.default_rng([seed, 2]), 1)
    rows, at, rng = [], [None, None], people.rng
    found, posterior = {}, posterior_of(records(1, rows, (0.5,)), seed)
    for number in range(MOST):
        way, phase = number % 2, 0.5
        if design.startswith("next"):
            step = 1.5 if design == DESIGNS[0] else 1e6
            push = next_push(records(1, rows, (0.5,)), posterior, "0", step)
            way, phase, size = WAYS.index(push.direction), push.phase, push.impulse_N_s
        elif design == "staircase":
            size = RANGES[way, 0] if at[way] is None else at[way]
        else:
            size = rng.uniform(*RANGES[way])
        stepped = bool(people.step(0, way, phase, size, number / 48))
        at[way] = float(np.clip(size / 1.25 if stepped else size * 1.25, *RANGES[way]))
        rows.append((0, way, phase, size, stepped))
        if not design.startswith("next") and number + 1 not in LOOKED_AT:
            continue
        posterior = posterior_of(records(1, rows, (0.5,)), seed)
        low, high, _ = ends_of(posterior, 0)
        for accuracy in ACCURACIES:
            if 50 * (high - low).mean() <= accuracy and accuracy not in found:
                found[accuracy] = number + 1
                found["steps"] = sum(row[4] for row in rows)
                found["held"] = 100 * np.mean((low <= people.t[0]) & (people.t[0] <= high))
        if ACCURACIES[-1] in found:
            break
    return {"design": design, "person": seed, **found}


def designs(persons: int) -> pd.DataFrame:
    """Pushes until both thresholds of a person are known, by design."""
    return pd.DataFrame([session(design, seed) for design in DESIGNS for seed in range(persons)])


def needed(table: pd.DataFrame) -> list[str]:
    """The table of designs: medians of the persons, and what suffices for four of five."""
    columns = " | ".join(f"±{accuracy} %" for accuracy in ACCURACIES)
    lines = [
        f"| design | persons | {columns} | steps | in 95 % |",
        "|" + "---|" * (len(ACCURACIES) + 4),
    ]
    for design, own in table.groupby("design", sort=False):
        cells = []
        for accuracy in ACCURACIES:
            pushes = np.sort(own[accuracy].fillna(MOST + 1))
            ends = pushes[len(own) // 2], pushes[(4 * len(own) - 1) // 5]
            cells.append(", ".join(f"{value:.0f}" if value <= MOST else f"above {MOST}" for value in ends))
        shown = " | ".join([*cells, f"{own['steps'].mean():.0f}", f"{own['held'].mean():.0f} %"])
        lines.append(f"| {design} | {len(own)} | {shown} |")
    return lines


def covered(table: pd.DataFrame) -> list[str]:
    """The table of coverage: of each truth, cohorts with shares covered in %, their standard errors, and drifts told."""
    lines = ["| truth | persons×pushes | covered, % | drift told, % |", "|---|---|---|---|"]
    for truth, own in table.groupby("truth", sort=False):
        cohorts = [
            f"{row.persons}×{row.pushes}"
            for row in own.rename(columns={"pushes of each": "pushes"}).itertuples()
        ]
        held = [f"{share:.0f}±{error:.1f}" for share, error in zip(own["covered %"], own["±"], strict=True)]
        drift = [f"{share:.0f}" for share in own["drift told %"]]
        lines.append(f"| {truth} | {' | '.join(map(', '.join, (cohorts, held, drift)))} |")
    return lines


def bodies(persons: int, phases: tuple[float, ...], pushes: int = 24) -> pd.DataFrame:
    """Simulated bodies, each pushed as `next_push` says, together; their thresholds at mid-movement by bisection."""
    rng, settings = np.random.default_rng(3), PushesSettings()
    motions = [
        deposit(f"p{index}", rng.uniform(55, 100), 5.0, foot=rng.uniform(0.17, 0.21))
        for index in range(persons)
    ]
    names = [item.subject for item in motions]
    scene = scene_of(motions, settings, draw_traits(names, settings.controller, settings.spread, 1))

    def falls(person, way, phase, size) -> np.ndarray:
        first, last = scene.references.first[person], scene.references.last[person]
        instant = first + (phase * (last - first)).astype(int)
        return simulate(scene, Pushes(person, instant, np.where(way == 0, size, -size))).falls

    person, way = np.repeat(np.arange(persons), 2), np.tile([0, 1], persons)
    low, high = np.full(2 * persons, 0.1), np.full(2 * persons, 200.0)
    for _ in range(14):
        middle = np.sqrt(low * high)
        fell = falls(person, way, np.full(len(way), 0.5), middle)
        low, high = np.where(fell, low, middle), np.where(fell, middle, high)
    true = np.log(np.sqrt(low * high)).reshape(persons, 2)
    rows: list[tuple] = []
    for number in range(pushes):
        done = records(persons, rows, phases)
        posterior = posterior_of(done, number)
        chosen = [next_push(done, posterior, str(one), 1.5) for one in range(persons)]
        ways = np.array([WAYS.index(item.direction) for item in chosen])
        phase, size = (
            np.array([getattr(item, name) for item in chosen]) for name in ("phase", "impulse_N_s")
        )
        fell = falls(np.arange(persons), ways, phase, size)
        rows += list(zip(range(persons), ways, phase, size, fell, strict=True))
    done = records(persons, rows, phases)
    posterior = posterior_of(done, 0)
    low, high, middle = np.quantile(posterior.log_threshold, [0.025, 0.975, 0.5], axis=0)
    held = (low <= true) & (true <= high)
    return pd.DataFrame(
        {
            "phases": len(phases),
            "direction": WAYS,
            "persons": persons,
            "pushes of each": pushes,
            "true, N·s": [f"{np.exp(item.min()):.1f} to {np.exp(item.max()):.1f}" for item in true.T],
            "covered %": 100 * held.mean(axis=0),
            "median error %": 100 * np.median(np.abs(middle - true), axis=0),
            "width": (high - low).mean(axis=0),
            "bend z": trends(done, predicted(done, posterior))[1],
        }
    )


def main() -> int:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cohorts", type=int, default=20)
    parser.add_argument("--persons", type=int, default=20)
    parser.add_argument("--only", nargs="+", choices=["bodies", "designs", "coverage"])
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--output", type=Path, default=Path("results/benchmarks/push_thresholds"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    made = {
        "bodies": (
            lambda count: pd.concat([bodies(count, phases) for phases in ((0.5,), PHASES)]),
            arguments.persons,
        ),
        "designs": (designs, arguments.persons),
        "coverage": (coverage, arguments.cohorts),
    }
    sections = {"designs": ("pushes needed", needed), "coverage": ("thresholds covered", covered)}
    for name in arguments.only or made:
        make, count = made[name]
        table = make(count)
        table.to_csv(arguments.output / f"{name}.csv", index=False)
        print(table.round(3).to_string(index=False), flush=True)
        if name in sections:
            section, lines_of = sections[name]
            show_section(arguments.markdown, section, lines_of(table))
    return 0


if __name__ == "__main__":
    sys.exit(main())
