"""A person's own feedback: are gains and delay found again, when do trials not tell, and what is the basin's area worth?

    python benchmarks/feedback.py [--people 60] [--trials 24] [--push 120] [--markdown docs/lifting/pushes.md]

Simulates people with a hidden regulator who are pushed at random instants of a movement, identifies them with the library's own
function, and compares the basin with what is found, and with the study's regulator, with that of the hidden one. What a basin
claims is tried on the simulated person: do its starts end in the goal set? With ``--markdown`` the table goes into that page.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import one_thread  # noqa: F401 # isort: skip

import numpy as np
import pandas as pd

from acceptance_page import show_section
from lumbar.base.errors import NumericalError
from lumbar.base.files import write_csv
from lumbar.lifting.pushes.feedback import (
    FURTHEST_DEG,
    basin_area,
    identify_feedback,
    interval_of,
)
from lumbar.lifting.stability.model.eq_4_1_pendulum import Pendulums
from lumbar.lifting.stability.model.eq_4_2_regulator import (
    check_weights,
    regulate,
    weights_of,
)
from lumbar.settings.stability import StabilitySettings

DURATION_S, POINTS, SUBSTEPS = 2.0, 201, 10
KINDS = {
    "regulator": "regulator, other weights",
    "fading regulator": "fading at the end",
    "delayed": "delayed by 60 to 140 ms",
    "threshold": "and above 0.6 to 1.7°",
    "act and wait": "and half the time",
    "wide threshold": "and above 1.7 to 6°",
}
LINEAR = tuple(KINDS)[:3]
STABILITY = StabilitySettings()


@dataclass(frozen=True)
class Person:
    """A pendulum that moves as it should, and who holds it."""

    pendulum: Pendulums
    gains: np.ndarray
    """Shape (points, 2): of the hidden regulator where it acts."""
    delay: float
    acts: Callable
    """Share of the torque that acts, of (time, felt angle, felt velocity)."""


@dataclass(frozen=True)
class Experiment:
    """How trials are recorded."""

    trials: int
    unpushed: int
    push_N_m: float
    noise_N_m: float = 6.0
    noise_s: float = 0.2
    angle_noise_rad: float = 1e-3
    mass_error: float = 0.0


def pendulum_of(rng) -> Pendulums:
    """A least-jerk movement from 0.4 to 0.05 rad of a body of 35 to 65 kg above its ankles."""
    s = np.linspace(0.0, 1.0, POINTS)
    mass, length = rng.uniform(35, 65), rng.uniform(0.8, 1.05)
    angle = 0.4 - 0.35 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return Pendulums(
        ("person (inverted)",),
        np.array([mass * length**2]),
        np.array([1.0]),
        np.array([-mass * 9.81 * length]),
        np.array([DURATION_S]),
        angle[:, None],
    )


def draw_person(rng, kind: str) -> Person:
    """Draw a person; kinds are `KINDS`."""
    pendulum = pendulum_of(rng)
    always = lambda time, e, w: 1.0  # noqa: E731
    if kind in LINEAR[:2]:
        state, control = np.diag([1.0, rng.uniform(0.02, 0.3)]), 10 ** rng.uniform(-5.5, -2.0)
        terminal = np.diag([100.0, 10.0])
        if kind == "regulator":
            # Its own cost of standing on: the gains do not fade towards the end.
            terminal = standing_cost(pendulum, state, control)
        gains = regulate(pendulum, check_weights(state, control, terminal)).gains[:, 0]
        return Person(pendulum, gains, 0.0, always)
    stiffness = rng.uniform(1.3, 2.0) * -pendulum.gravity_torque[0]
    gains = np.tile([stiffness, rng.uniform(0.25, 0.4) * stiffness], (POINTS, 1))
    delay = rng.uniform(0.06, 0.14)
    if kind == "delayed":
        return Person(pendulum, gains, delay, always)
    if kind.endswith("threshold"):
        size = rng.uniform(*((0.01, 0.03) if kind == "threshold" else (0.03, 0.1)))
        return Person(pendulum, gains, delay, lambda time, e, w: e**2 + (w / 3) ** 2 > size**2)
    period, phase = rng.uniform(0.2, 0.4), rng.uniform(0, 1)
    return Person(pendulum, 2 * gains, delay, lambda time, e, w: (time / period + phase) % 1 < 0.5)


def standing_cost(pendulum: Pendulums, state: np.ndarray, control: float) -> np.ndarray:
    """Solve the algebraic Riccati equation at the end of the movement."""
    from scipy.linalg import solve_continuous_are

    a21, a22, b2 = (float(part[0]) for part in pendulum.linearisation(pendulum.angle[-1]))
    return solve_continuous_are(
        np.array([[0.0, 1.0], [a21, a22]]), np.array([[0.0], [b2]]), state, np.array([[control]])
    )


def follow(person: Person, start: np.ndarray, torque: Callable) -> np.ndarray:
    """Follow errors with the true sine, shape (2, trials, points); `torque` of (step, time) is added."""
    pendulum = person.pendulum
    fine = (POINTS - 1) * SUBSTEPS
    step = DURATION_S / fine
    place = np.linspace(0.0, 1.0, fine + 1)
    known = np.linspace(0.0, 1.0, POINTS)
    mean = np.interp(place, known, pendulum.angle[:, 0])
    gains = np.stack([np.interp(place, known, column) for column in person.gains.T])
    lag = round(person.delay / step)
    states = np.zeros((fine + 1, *start.shape))
    states[0] = start
    for point in range(fine):
        e, w = states[point]
        felt = states[point - lag] if point >= lag else np.zeros_like(start)
        time = point * step
        own = person.acts(time, *felt) * (gains[0, point] * felt[0] + gains[1, point] * felt[1])
        gravity = pendulum.gravity_torque * (np.sin(mean[point] + e) - np.sin(mean[point]))
        change = (torque(point, time) - own - pendulum.damping * w - gravity) / pendulum.inertia
        states[point + 1] = e + step * w + 0.5 * step**2 * change, w + step * change
    return states[::SUBSTEPS].transpose(1, 2, 0)


def recorded(rng, person: Person, plan: Experiment) -> tuple[np.ndarray, np.ndarray]:
    """Angles and push torques of trials, shape (trials, points): pushes of 0.15 s forward and backward in turns."""
    size = plan.push_N_m * np.where(np.arange(plan.trials) % 2, 1, -1) * rng.uniform(0.5, 1.5, plan.trials)
    size[: plan.unpushed] = 0.0
    onset = rng.uniform(0.05, 0.55, plan.trials) * DURATION_S

    def push(time):
        return size * ((time >= onset) & (time < onset + 0.15))

    kept = np.exp(-DURATION_S / (POINTS - 1) / SUBSTEPS / plan.noise_s)
    noise = plan.noise_N_m * rng.standard_normal(plan.trials)

    def torque(point, time):
        nonlocal noise
        noise = kept * noise + plan.noise_N_m * np.sqrt(1 - kept**2) * rng.standard_normal(plan.trials)
        return push(time) + noise

    start = rng.standard_normal((2, plan.trials)) * np.array([[0.01], [0.05]])
    angle = person.pendulum.angle[:, 0] + follow(person, start, torque)[0]
    seen = angle + plan.angle_noise_rad * rng.standard_normal(angle.shape)
    return seen, np.stack([push(time) for time in np.linspace(0.0, DURATION_S, POINTS)], axis=1)


def true_area(person: Person) -> float:
    """Area of all starts from which the person returns, without noise, direction by direction."""
    goal, furthest = weights_of(STABILITY).terminal, np.radians(FURTHEST_DEG)
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    direction = furthest * np.stack([np.cos(turn), 5 * np.sin(turn)])
    radius, step = np.zeros(len(turn)), 2.0
    while step > 0.004:
        with np.errstate(all="ignore"):
            e, w = follow(person, (radius + step) * direction, lambda point, time: 0.0)
            value = goal[0] * e[:, -1] ** 2 + 2 * goal[1] * e[:, -1] * w[:, -1] + goal[2] * w[:, -1] ** 2
            returns = (np.abs(e).max(axis=1) < furthest) & (value <= STABILITY.goal_level)
        radius, step = radius + step * returns, step / 2
    return 5 * furthest**2 * np.pi * float(np.mean(radius**2))


def heavier(pendulum: Pendulums, share: float) -> Pendulums:
    """The pendulum as somebody takes it who errs about the mass."""
    return replace(
        pendulum,
        inertia=pendulum.inertia * (1 + share),
        gravity_torque=pendulum.gravity_torque * (1 + share),
    )


def examine(rng, kind: str, plan: Experiment) -> dict:
    """Record one person, identify, and only then look at what was hidden."""
    person = draw_person(rng, kind)
    angle, push = recorded(rng, person, plan)
    taken = heavier(person.pendulum, plan.mass_error)

    def areas(gains, delay):
        return basin_area(taken, gains, delay, STABILITY)

    assumed = regulate(taken, weights_of(STABILITY)).gains.transpose(1, 0, 2)
    row: dict = {"kind": kind, "told": False, "why": "no delay"}
    row["assumed_area"] = areas(assumed, np.zeros(1))[0]
    row["true_area"] = true_area(person)
    try:
        found = identify_feedback(taken, angle, push)
    except NumericalError:
        return row
    row |= {"told": not found.unknown, "why": "; ".join(word[:12] for word in found.unknown)}
    area = areas(found.gains, found.delay)
    row["area_low"], row["area_high"] = interval_of(area)
    row |= {"p_linear": found.p_linear, "identified_area": area[0]}
    middle = POINTS // 2
    estimates = dict(zip(("K1", "K2", "delay"), [*found.gains[:, middle].T, found.delay], strict=True))
    for (name, values), truth in zip(estimates.items(), [*person.gains[middle], person.delay], strict=True):
        low, high = interval_of(values)
        row |= {name: truth, f"{name}_found": values[0], f"{name}_low": low, f"{name}_high": high}
    return row


def held(table: pd.DataFrame) -> str:
    """Shares of intervals that hold the truth."""
    words = []
    for name, truth in {"K1": "K1", "K2": "K2", "delay": "delay", "area": "true_area"}.items():
        inside = (table[f"{name}_low"] <= table[truth]) & (table[truth] <= table[f"{name}_high"])
        words.append(f"{100 * inside.mean():.0f}")
    return f"{', '.join(words)} %"


def off_by(table: pd.DataFrame, regulator: str) -> str:
    """Errors of areas: median, worst."""
    if table.empty:
        return "–"
    error = 100 * (table[f"{regulator}_area"] / table["true_area"] - 1).abs()
    return f"{error.median():.0f}, {error.max():,.0f} %"


def report(table: pd.DataFrame) -> list[str]:
    """What was found of every kind of person, of those of whom the trials tell."""
    columns = "told | area off, identified: median, worst | assumed | in 95 %: K1, K2, delay, area"
    lines = [f"| hidden feedback | {columns} |", "|---|---|---|---|---|"]
    for kind, own in table.groupby("kind", sort=False):
        told = own[own["told"]]
        shown = off_by(told, "identified"), off_by(own, "assumed"), held(told) if kind in LINEAR else ""
        lines.append(f"| {KINDS[kind]} | {len(told)} of {len(own)} | {' | '.join(shown)} |")
    return lines


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", type=int, default=60)
    parser.add_argument("--trials", type=int, default=24)
    parser.add_argument("--unpushed", type=int, default=4)
    parser.add_argument(
        "--push", type=float, default=120.0, help="N·m; half to one and a half times as much is drawn"
    )
    parser.add_argument("--angle-noise", type=float, default=1e-3)
    parser.add_argument("--mass-error", type=float, default=0.0)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("results/benchmark/feedback.csv"))
    parser.add_argument("--markdown", type=Path)
    options = parser.parse_args()
    plan = Experiment(
        options.trials, options.unpushed, options.push,
        angle_noise_rad=options.angle_noise, mass_error=options.mass_error,
    )  # fmt: skip
    rows = [
        examine(np.random.default_rng([options.seed, list(KINDS).index(kind), number]), kind, plan)
        for kind in options.kinds
        for number in range(options.people)
    ]
    table = pd.DataFrame(rows)
    write_csv(options.output, table)
    show_section(options.markdown, "own feedback", report(table))


if __name__ == "__main__":
    main()
