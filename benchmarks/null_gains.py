"""Make the tables of gains where nothing is missing, which the diagnosis takes its probabilities from.

Every experiment has a true base of random parameters (a Kelvin–Boltzmann tissue or the pendulum of Eq. 4.1), a
multisine of random phases and slope of its spectrum (or band-limited noise), and noise that is white or, where its
colour can be known from the periods of a multisine, coloured; base and candidates are fitted as in a diagnosis.

    python benchmarks/null_gains.py --base KB --experiments 1000
    python benchmarks/null_gains.py --base pendulum --experiments 400

A table of fewer experiments than the shipped one takes its place nowhere: it needs ``--output``.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from lumbar.base.files import read_json, write_json
from lumbar.base.progress import track
from lumbar.records.record import Channel, Record
from lumbar.tissue.diagnosis.fitting.fit_data import FitData
from lumbar.tissue.diagnosis.fitting.joint_fit import add, fit_base
from lumbar.tissue.diagnosis.noise.noise_floor import noise_floor
from lumbar.tissue.diagnosis.selection import thresholds
from lumbar.tissue.effects.catalogue import catalogue_with
from lumbar.tissue.models.bases import BASES
from lumbar.tissue.models.motion import Motion
from lumbar.tissue.models.structure import Structure

STEP, PERIOD = 0.01, 10.0
"""Seconds."""


def forms_of(base: str) -> list:
    """Every candidate form of a base's catalogue."""
    return [form for effect in catalogue_with((), base).values() if not effect.rival for form in effect.forms]


def sines(time: np.ndarray, lines: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Sum of sines of random phases and slope of the spectrum, of largest value 1."""
    linear = lines ** random.choice([0.0, -0.5, -1.0])
    phases = random.uniform(0, 2 * np.pi, len(lines))
    values = np.cos(2 * np.pi * np.outer(time, lines) + phases) @ linear
    return values / np.abs(values).max()


def tissue_test(random: np.random.Generator) -> tuple[Motion, bool, np.ndarray, np.ndarray]:
    """Motion, whether it repeats, and parameters: periods of a multisine of 10 s, or noise, 0.1 to 5 Hz."""
    time = np.arange(0, random.choice([30, 60, 100]), STEP)
    periodic = random.random() < 0.8
    lines = np.arange(1, 51) * 0.1 if periodic else random.uniform(0.05, 5.0, 80)
    motion = Motion(time, sines(time, lines, random) * random.uniform(3, 8), STEP)
    linear = np.array([random.uniform(0.25, 0.9), random.uniform(0.2, 1.9)])
    return motion, periodic, linear, np.array([random.uniform(0.05, 0.35)])


def swings(random: np.random.Generator) -> tuple[Motion, bool, np.ndarray, np.ndarray]:
    """Motion, whether it repeats, and parameters: swings of 0.1 to 1.5 Hz, hanging or inverted.

    Box, length and pivot are measured, so that every candidate can be tried.
    """
    periodic = random.random() < 0.5
    # Of three periods the first is the transient: two do not tell the colour of slow noise.
    time = np.arange(0, random.choice([60, 100] if periodic else [30, 60]), STEP)
    lines = np.arange(1, 16) * 0.1 if periodic else random.uniform(0.06, 1.5, 14)
    angle = random.uniform(0, 0.3) + random.uniform(0.3, 0.9) * sines(time, lines, random)
    channels = {
        "box_held": (np.abs(time / time[-1] - random.uniform(0.3, 0.7)) < random.uniform(0.1, 0.3)) * 1.0,
        "length": 0.4 + 0.05 * sines(time, random.uniform(0.06, 1.0, 3), random),
        "pivot_acceleration_x": sines(time, random.uniform(0.1, 1.5, 3), random),
        "pivot_acceleration_z": sines(time, random.uniform(0.1, 1.5, 3), random),
    }
    gravity = random.choice([-1, 1]) * random.uniform(60, 250)
    linear = np.array([random.uniform(2, 20), random.uniform(2, 12), gravity])
    return Motion(time, angle, STEP, channels=channels), periodic, linear, np.zeros(0)


EXCITATIONS = {"KB": tissue_test, "pendulum": swings}


def unit_noise(random: np.random.Generator, samples: int, coloured: bool) -> np.ndarray:
    """White noise, or half and half first-order autoregressive and 1/f noise; of variance 1."""
    white = random.standard_normal(samples)
    if not coloured:
        return white
    if random.random() < 0.5:
        noise = lfilter([1.0], [1.0, -random.uniform(0.3, 0.8)], white)
    else:
        frequency = np.maximum(np.fft.rfftfreq(samples, STEP), 0.1)
        noise = np.fft.irfft(np.fft.rfft(white) / np.sqrt(frequency), samples)
    return noise / noise.std()


def largest_gain(base: str, seed: int) -> float:
    """Largest gain in twice the log-likelihood among all candidates, for one null experiment."""
    random = np.random.default_rng([20260, seed])
    structure = Structure(BASES[base])
    motion, periodic, linear, nonlinear = EXCITATIONS[base](random)
    clean = structure.simulate(motion, linear, nonlinear)
    share = random.choice([0.005, 0.01, 0.02, 0.3])
    coloured = periodic and random.random() < 0.4
    output = clean + share * clean.std() * unit_noise(random, len(clean), coloured)
    whitening = known_colour(motion, output) if periodic else np.ones(1)
    data = FitData("null", motion, output, whitening)
    fitted = fit_base(structure, data)
    best = min(add(fitted, form, data).squared_error for form in forms_of(base))
    return data.size * float(np.log(fitted.squared_error / best))


def known_colour(motion: Motion, output: np.ndarray) -> np.ndarray:
    """Whitening filter, as a diagnosis estimates it from the periods."""
    channels = {"input": Channel(motion.position, "", ""), "output": Channel(output, "", "")}
    return noise_floor(Record("null", motion.time, channels), PERIOD).whitening


def main() -> None:
    """Simulate and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", choices=sorted(EXCITATIONS), default="KB")
    parser.add_argument("--experiments", type=int, default=1000)
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    parser.add_argument("--output", type=Path, help="elsewhere than the shipped table")
    options = parser.parse_args()
    system = BASES[options.base].system
    shipped = Path(thresholds.__file__).with_name(f"null_distribution_{system}.json")
    if options.output is None and options.experiments < (least := len(read_json(shipped)["gains"])):
        parser.error(
            f"--experiments {options.experiments}: the shipped {shipped.name} has {least}; request more or give an --output"
        )
    with ProcessPoolExecutor(options.cores) as pool:
        tasks = [pool.submit(largest_gain, options.base, seed) for seed in range(options.experiments)]
        gains = sorted(round(task.result(), 4) for task in track(tasks, "null experiments"))
    content = {"schema": "lumbar.null_gains/1", "forms": len(forms_of(options.base)), "base": options.base}
    write_json(options.output or shipped, {**content, "gains": gains})
    print(f"quantiles 50, 90, 99 %: {np.quantile(gains, [0.5, 0.9, 0.99])}")


if __name__ == "__main__":
    main()
