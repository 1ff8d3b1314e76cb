"""Pictures of ``docs/tissue/laboratory_tests.md``: what the usual tests of laboratories show of four effects.

The tissue is simulated with formulas of this file only. The lower panel of a picture is the residual of a Kelvin–Boltzmann
model that is fitted to the tissue with one effect: the part of the effect that no change of the model's three parameters
can imitate. If it is near 0, the test cannot show this effect.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, least_squares
from scipy.signal import chirp, lfilter

from lumbar.publishing.figures import style

PICTURES = Path(__file__).resolve().parents[1] / "tissue" / "images" / "laboratory_tests"
RATE_HZ = 500.0
SPRING_N_MM, BRANCH_N_MM, RELAXATION_S = 0.3, 0.5, 0.3
"""Parameters of the Kelvin–Boltzmann tissue."""
FRICTION_N, CUBIC_N_MM3, SECOND_BRANCH_N_MM, SECOND_RELAXATION_S = 0.2, 0.02, 0.25, 3.0
"""Sizes of the effects."""
SHOWN_S = dict.fromkeys(("chirp", "multisine", "prestrain", "two_level", "five_level"), (10.0, 16.0))
"""Seconds that the pictures of fast motions show; the others show the whole test."""
COLORS = {
    "Coulomb friction": "#d55e00",
    "hardening stiffness": "#0072b2",
    "second relaxation": "#009e73",
}


def branch_force(position: np.ndarray, stiffness: float, relaxation_s: float) -> np.ndarray:
    """Return the force of a Maxwell branch for a position that is straight between samples; exact, at rest before."""
    decay = np.exp(-1 / (RATE_HZ * relaxation_s))
    steps = np.diff(position, prepend=position[0]) * stiffness * relaxation_s * RATE_HZ * (1 - decay)
    return lfilter([1.0], [1.0, -decay], steps)


def tissue_force(position: np.ndarray) -> np.ndarray:
    """Return the force of the Kelvin–Boltzmann tissue."""
    return SPRING_N_MM * position + branch_force(position, BRANCH_N_MM, RELAXATION_S)


def effect_forces(position: np.ndarray) -> dict[str, np.ndarray]:
    """Return the force that each effect adds to the tissue."""
    # Friction keeps its sign while the position rests, as a stuck contact does.
    direction = np.sign(np.diff(position, prepend=position[0]))
    last = np.maximum.accumulate(np.where(direction != 0, np.arange(len(position)), 0))
    forces = (
        FRICTION_N * direction[last],
        CUBIC_N_MM3 * position**3,
        branch_force(position, SECOND_BRANCH_N_MM, SECOND_RELAXATION_S),
    )
    return dict(zip(COLORS, forces, strict=True))


def refitted_residual(position: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the residual of a Kelvin–Boltzmann model with its own zero, fitted to a force by least squares."""

    def residual(log_relaxation: np.ndarray) -> np.ndarray:
        branch = branch_force(position, 1.0, float(np.exp(log_relaxation[0])))
        columns = np.column_stack([position, branch, np.ones(len(position))])
        return force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]

    starts = np.log(np.geomspace(0.03, 10.0, 8))
    best = min(starts, key=lambda start: float(np.sum(residual(np.array([start])) ** 2)))
    return residual(least_squares(residual, [best]).x)


def follow(times: list[float], levels: list[float]) -> np.ndarray:
    """Return a position that is straight between levels at given times."""
    clock = np.arange(0.0, times[-1], 1 / RATE_HZ)
    return np.interp(clock, times, levels)


def multilevel(levels: np.ndarray, seed: int) -> np.ndarray:
    """Return random levels of 0.2 s during 20 s, with a slew of 5 ms between them as a servo has."""
    chosen = np.random.default_rng(seed).choice(levels, 100)
    held = np.repeat(chosen, round(0.2 * RATE_HZ))
    return lfilter(np.full(3, 1 / 3), [1.0], held - held[0]) + held[0]


def protocols() -> dict[str, np.ndarray]:
    """Return the position in mm of each test in which the position is controlled, by the name of its picture."""
    clock = np.arange(0.0, 20.0, 1 / RATE_HZ)
    generator = np.random.default_rng(4)
    lines = np.arange(1, 61, 2) * 0.1
    phases = generator.uniform(0, 2 * np.pi, len(lines))
    multisine = np.cos(2 * np.pi * np.outer(clock, lines) + phases).sum(axis=1)
    presses = sum(
        depth * np.exp(-(((clock - at) / 0.7) ** 2))
        for at, depth in [(2, 3), (5.5, 4.5), (9, 2.2), (13, 5), (17, 3.6)]
    )
    return {
        "relaxation": follow([0, 1, 1.5, 20], [0, 0, 5, 5]),
        "three_relaxations": follow(
            [0, 1, 1.25, 6, 7, 8, 10, 15, 16, 17, 22, 28], [0, 0, 5, 5, 0, 0, 5, 5, 0, 0, 5, 5]
        ),
        "staircase": follow(
            [0, 1, 1.5, 5, 5.5, 9, 9.5, 13, 13.5, 17, 17.5, 20], [0, 0, 2, 2, 4, 4, 6, 6, 3, 3, 0, 0]
        ),
        "triangles": follow(
            [0, 4, 8, 9, 10, 11, 12, 12.25, 12.75, 13.25, 13.5], [0, 5, 0, 5, 0, 5, 0, 5, 0, 5, 0]
        ),
        "hand_presses": presses,
        "two_level": multilevel(np.array([-3.0, 3.0]), 1),
        "five_level": multilevel(np.linspace(-4, 4, 5), 2),
        "multisine": 1.2 * multisine / np.std(multisine),
        "prestrain": 4 + 1.5 * np.sin(2 * np.pi * 0.5 * clock),
        "chirp": 3 * chirp(clock, 0.1, 20.0, 5.0),
    }


def creep() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the force of a creep and recovery test, and the position of the tissue without and with hardening."""
    clock = np.arange(0.0, 20.0, 1 / RATE_HZ)
    force = np.where((clock >= 1) & (clock < 11), 2.0, 0.0)
    positions = {}
    for name, cubic in (("Kelvin–Boltzmann", 0.0), ("hardening stiffness", CUBIC_N_MM3)):

        def position(load: float, dashpot: float, cubic: float = cubic) -> float:
            return brentq(
                lambda z: SPRING_N_MM * z + cubic * z**3 + BRANCH_N_MM * (z - dashpot) - load, -50.0, 50.0
            )

        def rate(time: float, state: np.ndarray, place: Callable[..., float] = position) -> list[float]:
            load = 2.0 if 1 <= time < 11 else 0.0
            return [(place(load, state[0]) - state[0]) / RELAXATION_S]

        path = solve_ivp(rate, (0, 20), [0.0], t_eval=clock, max_step=0.05, rtol=1e-7).y[0]
        positions[name] = np.array([position(*pair) for pair in zip(force, path, strict=True)])
    return force, positions


@style.house_style
def draw(name: str, position: np.ndarray) -> None:
    """Draw position, force and what each effect leaves after a refit."""
    clock = np.arange(len(position)) / RATE_HZ
    force = tissue_force(position)
    figure, (left, middle, right) = style.new_figure(9.0, 2.2, ncols=3)
    left.plot(clock, position, color=style.MEASURED)
    left.set_title("position (mm)")
    middle.plot(clock, force, color=style.MEASURED, label="Kelvin–Boltzmann")
    right.axhspan(-0.02, 0.02, color="#cccccc", linewidth=0, label="noise")
    for effect, added in effect_forces(position).items():
        middle.plot(clock, force + added, color=COLORS[effect], linewidth=0.7)
        residual = refitted_residual(position, force + added)
        right.plot(clock, residual, color=COLORS[effect], linewidth=0.9, label=f"+ {effect}")
    middle.set_title("force (N)")
    right.set_title("residual of the refitted base (N)")
    for axis in (left, middle, right):
        axis.set_xlabel("Time (s)")
        axis.set_xlim(*SHOWN_S.get(name, (0, clock[-1])))
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    save(figure, name)


@style.house_style
def draw_creep() -> None:
    """Draw force and position of a creep test."""
    force, positions = creep()
    clock = np.arange(len(force)) / RATE_HZ
    figure, (left, right) = style.new_figure(6.0, 2.2, ncols=2)
    left.plot(clock, force, color=style.MEASURED)
    left.set_title("force, the input (N)")
    for (name, position), color in zip(
        positions.items(), (style.MEASURED, COLORS["hardening stiffness"]), strict=True
    ):
        right.plot(clock, position, color=color, label=name)
    right.set_title("position (mm)")
    for axis in (left, right):
        axis.set_xlabel("Time (s)")
    right.legend()
    save(figure, "creep")


def save(figure, name: str) -> None:
    """Write a picture, with the source of its data at its foot."""
    figure.supxlabel("Data: synthetic twin", x=0.995, ha="right", fontsize=6, color="#555555")
    PICTURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURES / f"{name}.png", dpi=100, pil_kwargs={"optimize": True})


def main() -> None:
    """Draw all pictures."""
    for name, position in protocols().items():
        draw(name, position)
    draw_creep()


if __name__ == "__main__":
    main()
