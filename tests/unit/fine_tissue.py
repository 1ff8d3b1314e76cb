"""Tissue tests simulated in fine steps, apart from the library's own solvers: everything in them is known."""

import numpy as np
from periodic_records import record
from scipy.signal import lfilter

from lumbar.records.record import Record
from lumbar.tissue.diagnosis.selection.diagnosis_steps import diagnose

FINE = 20
"""Steps of the simulation between two samples."""


def sines(seed: int, seconds: float, step: float, fastest: float, slowest: float = 0.25, size: float = 0.5):
    """Time (s) on the fine clock, position (mm) and speed of 12 sines that repeat with the slowest one."""
    time = np.arange(round(seconds / step) * FINE) * step / FINE
    orders = np.unique(np.round(np.geomspace(1, fastest / slowest, 12)))
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(orders))
    position, speed = np.zeros(len(time)), np.zeros(len(time))
    for order, angle in zip(orders, phase, strict=True):
        omega = 2 * np.pi * slowest * order
        position += size * np.sin(omega * time + angle)
        speed += size * omega * np.cos(omega * time + angle)
    return time, position, speed


def branch(position: np.ndarray, relaxation: float, step: float) -> np.ndarray:
    """Elongation of a Maxwell branch's spring, at rest at first, by the trapezoidal rule on the fine clock."""
    half = step / FINE / relaxation / 2
    return lfilter([1 / (1 + half), -1 / (1 + half)], [1.0, -(1 - half) / (1 + half)], position - position[0])


def sampled(name: str, step: float, position, force, noise: float, seed: int, zero: float = 0.0) -> Record:
    """Record of every `FINE`-th step, with white noise (N) and the force sensor's zero (N)."""
    position, force = position[::FINE].copy(), force[::FINE].copy()
    force += zero + noise * np.random.default_rng(seed + 900).standard_normal(len(force))
    return record(position, force, name, step=step)


def experiment(
    force, noise: float = 0.01, step: float = 0.02, fastest: float = 4.0, zeros=(0.0, 0.0), seconds=(24, 12)
) -> list[Record]:
    """A periodic record and an unseen one; `force` gives the tissue's from time, position, speed and step."""
    records = []
    for seed, (name, slowest, zero, duration) in enumerate(
        zip(("multisine", "other"), (0.25, 0.261), zeros, seconds, strict=True)
    ):
        time, position, speed = sines(seed, duration, step, fastest, slowest)
        tissue = force(time, position, speed, step)
        records.append(sampled(name, step, position, tissue, noise, seed, zero))
    return records


def palpation(force_beside=lambda depth: 0.0, noise: float = 0.02, surface: float = 3.0, step: float = 0.02):
    """Records of a tool that presses on a tissue from above and leaves it again: 1.2 N/mm and a branch of 0.8 N/mm, 0.3 s.

    The surface follows the tool while it is pressed on and comes back by itself when it is not.
    """
    records = []
    for seed, (name, seconds, rate) in enumerate((("slow", 14.0, 0.35), ("fast", 7.0, 0.6))):
        time = np.arange(round(seconds / step) * FINE) * step / FINE
        swell = 1.0 + 0.35 * np.sin(2 * np.pi * 0.11 * time + seed)
        tool = surface + 0.6 + swell * (-2.2 * np.cos(2 * np.pi * rate * time) + 0.4 * np.sin(9.1 * time))
        force = _pressed((tool - surface).tolist(), step / FINE, force_beside)
        records.append(sampled(name, step, tool, force, noise, seed))
    return records


def _pressed(depth: list[float], step: float, force_beside) -> np.ndarray:
    """Force on the tool by Heun's method; `dashpot` is the position of the branch's dashpot."""
    spring, stiff, relaxation = 1.2, 0.8, 0.3
    dashpot, forces = 0.0, np.zeros(len(depth))

    def touched(tool: float, dashpot: float) -> float:
        # The free surface is where spring and branch hold each other.
        return max(tool, stiff * dashpot / (spring + stiff))

    for index, tool in enumerate(depth):
        surface = touched(tool, dashpot)
        if tool >= surface:
            forces[index] = spring * tool + stiff * (tool - dashpot) + force_beside(tool)
        rate = (surface - dashpot) / relaxation
        following = depth[min(index + 1, len(depth) - 1)]
        ahead = dashpot + step * rate
        dashpot += step * (rate + (touched(following, ahead) - ahead) / relaxation) / 2
    return np.maximum(forces, 0.0)


def diagnosed_effects(records: list[Record], settings=None) -> tuple[str, tuple[str, ...], str]:
    """Base, selected effects and verdict of a diagnosis."""
    diagnosis = diagnose(records, settings)
    return diagnosis.base.fit.structure.base.name, diagnosis.selected, diagnosis.status
