"""A second set of synthetic tissue tests: a Kelvin–Boltzmann tissue with dry friction that hardens, and little noise.

Tissue, motion and effects are drawn. The benchmark of the diagnosis (``benchmarks/hidden_effects``) hides many more effects in
such tissues: these recordings are those of one of its pairs.
"""

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from lumbar.base.files import write_text
from lumbar.settings.twin import TwoHiddenEffectsSettings
from lumbar.twin.kelvin_boltzmann import Tissue, severity_leaving
from lumbar.twin.tool_motion import RATE_HZ, ToolMotion, draw_motions

HEADER = "time_s,position_mm,force_N"
PAIR = 1
"""Number of this kind of experiment among those of the benchmark, a part of the seed."""
FORMS = 4
"""Forms of friction, and of hardening, among which the benchmark draws."""


@dataclass(frozen=True)
class TissueTestRanges:
    """Ranges of tissues and excitations."""

    elastic_N_per_mm: tuple[float, float] = (0.25, 0.9)
    """Stiffness at rest."""
    relaxing_over_elastic: tuple[float, float] = (0.7, 2.5)
    """The relaxing branch's stiffness over it."""
    relaxing_N_per_mm: tuple[float, float] = (0.2, 1.9)
    """Limits of the relaxing branch's stiffness."""
    relaxation_s: tuple[float, float] = (0.05, 0.35)
    """The branch's time constant."""
    amplitude_mm: tuple[float, float] = (3.0, 8.0)
    """Largest displacement."""
    periods: int = 10
    """Periods of 10 s in the multisine."""


def draw_test(rng: np.random.Generator, ranges: TissueTestRanges) -> tuple[Tissue, dict[str, ToolMotion]]:
    """Draw a tissue, and the motions of its multisine, chirp and noise."""
    elastic = rng.uniform(*ranges.elastic_N_per_mm)
    relaxing = float(np.clip(elastic * rng.uniform(*ranges.relaxing_over_elastic), *ranges.relaxing_N_per_mm))
    tissue = Tissue(float(elastic), relaxing, log_uniform(rng, *ranges.relaxation_s))
    motions = draw_motions(
        rng,
        peak_mm=float(rng.uniform(*ranges.amplitude_mm)),
        slope=float(rng.choice([0.0, -0.5])),
        schroeder=bool(rng.integers(2)),
        periods=ranges.periods,
    )
    return tissue, motions


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Random number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def friction(motion: ToolMotion, strength: float, speed_mm_s: float) -> np.ndarray:
    """Dry friction F_c (2/π) arctan(v/v_s), N."""
    return strength * 2 / np.pi * np.arctan(motion.velocity / speed_mm_s)


def hardening(motion: ToolMotion, strength: float) -> np.ndarray:
    """Hardening k₃z³, N."""
    return strength * motion.position**3


def added_strength(force_N: float, unit_N: float, severity: float) -> float:
    """Strength of an effect that adds a force: from 10⁻⁴ to 3 times the tissue's own, evenly in the logarithm.

    `force_N` is the RMS of that, `unit_N` the size of the added force at strength 1, `severity` 0 (weakest) to 1.
    """
    full = force_N / unit_N
    weakest, strongest = 1e-4 * full, 3.0 * full
    return float(weakest * (strongest / weakest) ** severity)


def two_hidden_effects(
    settings: TwoHiddenEffectsSettings, seed: int, ranges: TissueTestRanges | None = None
) -> dict[str, np.ndarray]:
    """Make the records: time (s), position (mm), force (N) in columns, by record name."""
    rng = np.random.default_rng([seed, PAIR, settings.number])
    tissue, motions = draw_test(rng, ranges or TissueTestRanges())
    # The benchmark also draws size, colour and correlation of the noise and the form of either effect, given here.
    rng.random(3)
    for _ in ("friction", "hardening"):
        rng.integers(FORMS)
    speed_mm_s = log_uniform(rng, 0.2, 1.5)
    multisine = motions["multisine"]
    rest = tissue.force(multisine)
    force_N, half_depth = float(rest.std()), 0.5 * float(np.abs(multisine.position).max())
    noise_N = settings.noise_share * force_N

    def calibrated(effect, unit_N: float):
        """The effect at the strength at which it alone leaves the wanted residual."""
        severity = severity_leaving(
            noise_N * settings.residual_over_noise,
            multisine,
            lambda severity: rest + effect(multisine, added_strength(force_N, unit_N, severity)),
            least_N=1e-9 * force_N,
        )
        return partial(effect, strength=added_strength(force_N, unit_N, severity))

    effects = [
        calibrated(partial(friction, speed_mm_s=speed_mm_s), 1.0),
        calibrated(hardening, half_depth**3),
    ]
    records = {}
    for name, motion in motions.items():
        force = tissue.force(motion)
        for effect in effects:
            force = force + effect(motion)
        clean = motion.sampled(force)
        noise = noise_N * rng.standard_normal(len(clean))
        records[name] = np.column_stack(
            [np.arange(len(clean)) / RATE_HZ, motion.sampled(motion.position), clean + noise]
        )
    return records


def write_records(folder: str | os.PathLike, records: dict[str, np.ndarray]) -> None:
    """Write one CSV file per record: header ``time_s,position_mm,force_N``, five decimals."""
    for name, values in records.items():
        lines = ["%.2f,%.5f,%.5f" % row for row in map(tuple, values.tolist())]  # noqa: UP031 - twice as fast
        write_text(Path(folder) / f"{name}.csv", "\n".join([HEADER, *lines]) + "\n")
