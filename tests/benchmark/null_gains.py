"""Make the table of gains where nothing is missing, which the diagnosis takes its probabilities from.

Every experiment has a true Kelvin–Boltzmann tissue of random parameters, a multisine of random phases and slope of
its spectrum (or band-limited noise), and noise that is white or, where its colour can be known from the periods of a
multisine, coloured; base and candidates are fitted as in a diagnosis.

    python tests/benchmark/null_gains.py --experiments 1000
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from scipy.signal import lfilter

from lumbar.effects.base import BASES
from lumbar.effects.catalogue import TISSUE
from lumbar.effects.motion import Motion
from lumbar.effects.structure import Structure
from lumbar.files import write_json
from lumbar.improvement.fitting import FitData, add, fit_base
from lumbar.improvement.noise_floor import noise_floor
from lumbar.improvement.null_gains import TABLE
from lumbar.progress import track
from lumbar.records.record import Channel, Record

FORMS = [form for effect in TISSUE.values() for form in effect.forms]
STEP, PERIOD = 0.01, 10.0
"""Seconds."""


def excitation(random: np.random.Generator) -> tuple[Motion, bool]:
    """Random excitation, 0.1 to 5 Hz: periods of a multisine of 10 s, or noise that does not repeat."""
    seconds = random.choice([30, 60, 100])
    time = np.arange(0, seconds, STEP)
    periodic = random.random() < 0.8
    lines = np.arange(1, 51) * 0.1 if periodic else random.uniform(0.05, 5.0, 80)
    amplitudes = lines ** random.choice([0.0, -0.5, -1.0])
    phases = random.uniform(0, 2 * np.pi, len(lines))
    position = np.cos(2 * np.pi * np.outer(time, lines) + phases) @ amplitudes
    return Motion(time, position * random.uniform(3, 8) / np.abs(position).max(), STEP), periodic


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


def largest_gain(seed: int) -> float:
    """Largest gain in twice the log-likelihood among all candidates, for one null experiment."""
    random = np.random.default_rng([20260, seed])
    structure = Structure(BASES["KB"])
    motion, periodic = excitation(random)
    amplitudes = np.array([random.uniform(0.25, 0.9), random.uniform(0.2, 1.9)])
    clean = structure.simulate(motion, amplitudes, np.array([random.uniform(0.05, 0.35)]))
    share = random.choice([0.005, 0.01, 0.02, 0.3])
    coloured = periodic and random.random() < 0.4
    force = clean + share * clean.std() * unit_noise(random, len(clean), coloured)
    whitening = known_colour(motion, force) if periodic else np.ones(1)
    data = FitData("null", motion, force, whitening)
    base = fit_base(structure, data)
    best = min(add(base, form, data).squared_error for form in FORMS)
    return data.size * float(np.log(base.squared_error / best))


def known_colour(motion: Motion, force: np.ndarray) -> np.ndarray:
    """Whitening filter, as a diagnosis estimates it from the periods."""
    channels = {
        "input": Channel(motion.position, "position", "mm"),
        "output": Channel(force, "force", "N"),
    }
    return noise_floor(Record("null", motion.time, channels), PERIOD).whitening


def main() -> None:
    """Simulate and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--experiments", type=int, default=1000)
    parser.add_argument("--cores", type=int, default=os.cpu_count())
    options = parser.parse_args()
    with ProcessPoolExecutor(options.cores) as pool:
        gains = pool.map(largest_gain, range(options.experiments), chunksize=5)
        found = sorted(round(value, 4) for value in track(gains, "null experiments", options.experiments))
    write_json(TABLE, {"schema": "lumbar.null_gains/1", "forms": len(FORMS), "base": "KB", "gains": found})
    print(f"quantiles 50, 90, 99 %: {np.quantile(found, [0.5, 0.9, 0.99])}")


if __name__ == "__main__":
    main()
