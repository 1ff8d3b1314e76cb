"""Simulated tissue tests for `calibration.py`: linear tissues with noise and sensor faults, and tissues with one known effect.

Made with the simulator of the hidden effects, on a grid twenty times as fine as the samples, which shares no code with what is
fitted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hidden_effects.catalogue import form_named
from hidden_effects.form import HiddenEffect, Scales, calibrated, simulate
from hidden_effects.noise import draw_noise
from lumbar.records.record import Channel, Record
from lumbar.tissue.effects.catalogue import TISSUE as CATALOGUE
from lumbar.tissue.models.form import Effect, Form
from lumbar.twin.two_hidden_effects import (
    RATE_HZ,
    Tissue,
    ToolMotion,
    draw_motions,
    log_uniform,
    maxwell_force,
)

PERIODS = {"clock skew": 6}
"""Numbers of periods of 10 s in the training record; a skew needs five periods to be detected. The unseen record is 10 s of noise
in the same band, 0.1 to 5 Hz."""
_FEW_PERIODS = 3
NOISE_SHARE = (0.005, 0.03)
"""RMS of the force's noise in that of the force."""
EFFECT_OVER_NOISE = (3.0, 20.0)
"""RMS that the best Kelvin–Boltzmann tissue leaves of a known effect, in that of the noise."""
MAINS_HZ = (49.9, 50.1)

NOISES = ("white", "AR(1)", "hum", "heavy tails")
FAULTS = ("position noise", "quantised position", "jitter", "clock skew", "held samples")
CONDITIONS = (*NOISES, *FAULTS)
"""Under which nothing is hidden; faults come with white noise."""
TRUE_NAMES = {"hum": {"periodic_disturbance"}}
"""Effects that name what a condition is."""
LINEAR_TISSUES = ("KB", "KV", "Maxwell")
COLOURS = ("white", "AR(1)", "1/f")
"""Noises of the experiments with a known effect."""


def _tissue(rng: np.random.Generator) -> Tissue:
    return Tissue(rng.uniform(0.25, 0.9), rng.uniform(0.2, 1.9), log_uniform(rng, 0.05, 0.35))


def _motions(rng: np.random.Generator, periods: int = _FEW_PERIODS) -> list[ToolMotion]:
    """Training and unseen motion."""
    motions = draw_motions(
        rng, rng.uniform(3, 8), float(rng.choice([0.0, -0.5])), bool(rng.integers(2)), periods
    )
    return [motions["multisine"], motions["noise"]]


def _linear_force(kind: str, tissue: Tissue, motion: ToolMotion) -> np.ndarray:
    if kind == "KV":
        # The dashpot of the branch, without its spring.
        return tissue.elastic * motion.position + tissue.relaxing * tissue.relaxation_s * motion.velocity
    if kind == "Maxwell":
        return maxwell_force(motion.position, motion.step, tissue.relaxing, tissue.relaxation_s)
    return tissue.force(motion)


def _unit_noise(kind: str, rng: np.random.Generator, samples: int) -> np.ndarray:
    """Return noise of variance 1; hum is added to white noise of variance 1."""
    if kind == "heavy tails":
        return rng.standard_t(3, samples) / np.sqrt(3)
    white = rng.standard_normal(samples)
    if kind == "hum":
        angle = 2 * np.pi * rng.uniform(*MAINS_HZ) * np.arange(samples) / RATE_HZ
        return white + np.sqrt(2) * np.sin(angle + rng.uniform(0, 2 * np.pi))
    if kind in ("AR(1)", "1/f"):
        colour = "autoregressive" if kind == "AR(1)" else "flicker"
        return draw_noise(rng, samples, 1.0, colour, rng.uniform(0.3, 0.9), RATE_HZ)
    return white


def _recorded(
    fault: str, size: float, rng: np.random.Generator, motion: ToolMotion, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Recorded position, and force without noise.

    Parameters
    ----------
    size : float
        From 0 (slight) to 1 (gross), even in the logarithm of the fault's own size.
    force : numpy.ndarray
        On the grid of the motion.
    """
    time, position = motion.sampled(motion.time), motion.sampled(motion.position).copy()
    sound, span = motion.sampled(force), np.ptp(position)

    def between(low: float, high: float) -> float:
        return low * (high / low) ** size

    if fault == "position noise":
        position += between(3e-4, 1e-2) * span * rng.standard_normal(len(time))
    elif fault == "quantised position":
        step = between(1e-3, 3e-2) * span
        position = step * np.round(position / step)
    elif fault == "jitter":
        late = between(1e-4, 2e-3) * rng.standard_normal(len(time))
        position = np.interp(time + late, motion.time, motion.position)
    elif fault == "clock skew":
        sound = np.interp(time * (1 - between(1e-5, 1e-3)), motion.time, force)
    elif fault == "held samples":
        held = np.flatnonzero(rng.random(len(time)) < between(1e-3, 1e-2))
        for index in held[held > 0]:
            position[index : index + 3] = position[index - 1]
    return position, sound


def _record(name: str, position: np.ndarray, force: np.ndarray) -> Record:
    channels = {"input": Channel(position, "position", "mm"), "output": Channel(force, "force", "N")}
    return Record(name, np.arange(len(position)) / RATE_HZ, channels)


def null_records(condition: str, tissue: str, seed: int) -> list[Record]:
    """Training and unseen record of a linear tissue.

    Parameters
    ----------
    condition : str
        Of `CONDITIONS`.
    tissue : str
        Of `LINEAR_TISSUES`.
    seed : int
    """
    rng = np.random.default_rng([20261, CONDITIONS.index(condition), LINEAR_TISSUES.index(tissue), seed])
    drawn = _tissue(rng)
    motions, size = _motions(rng, PERIODS.get(condition, _FEW_PERIODS)), rng.random()
    share, records = log_uniform(rng, *NOISE_SHARE), []
    rms = share * float(np.std(_linear_force(tissue, drawn, motions[0])))
    for motion in motions:
        position, force = _recorded(condition, size, rng, motion, _linear_force(tissue, drawn, motion))
        noise = _unit_noise(condition, rng, len(force))
        records.append(_record(motion.record, position, force + rms * noise))
    return records


@dataclass(frozen=True)
class KnownEffect:
    """An effect whose simulated form is one of the catalogue's.

    Attributes
    ----------
    label : str
        Of the simulated form.
    fitted : str
        Name of the catalogue's form.
    truth : callable
        From strength and other parameters to the values of the fitted parameters, by name.
    """

    label: str
    fitted: str
    truth: Callable[[float, dict], dict[str, float]]

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return self.label.split(":")[0]

    @property
    def form(self) -> Form:
        """The catalogue's form."""
        return next(form for form in CATALOGUE[self.effect].forms if form.name == self.fitted)


def _named(name: str, **shapes: str) -> Callable[[float, dict], dict[str, float]]:
    """The strength under one name, other parameters under theirs."""
    return lambda strength, shape: {name: strength, **{new: shape[old] for new, old in shapes.items()}}


KNOWN = (
    KnownEffect("hardening_stiffness:cubic", "cubic", _named("cubic_stiffness")),
    KnownEffect("coulomb_friction:tanh", "coulomb", _named("coulomb_force", smoothing_speed="speed_mm_s")),
    KnownEffect("hysteresis:dahl", "dahl", _named("friction_limit", presliding_distance="yield_mm")),
    KnownEffect("quadratic_damping:quadratic", "quadratic", _named("quadratic_damping")),
    KnownEffect(
        "depth_dependent_damping:bilinear",
        "bilinear",
        lambda strength, shape: {
            "damping_per_depth": strength,
            "damping_at_zero": strength * shape["offset_mm"],
        },
    ),
    KnownEffect("inertia:mass", "mass", _named("mass")),
    KnownEffect(
        "second_relaxation:slow", "maxwell_branch", _named("branch_stiffness", relaxation_time="relaxation_s")
    ),
    KnownEffect("delay:transport", "pure", _named("delay")),
    KnownEffect("saturation:clip", "sharp", _named("limit")),
    KnownEffect("backlash:sharp", "play", _named("half_gap")),
)


@dataclass(frozen=True, eq=False)
class Experiment:
    """Records with a known effect, and the true values of base (effect ``""``) and effect by effect and name."""

    records: list[Record]
    truth: dict[tuple[str, str], float]


def effect_experiment(known: KnownEffect, colour: str, seed: int) -> Experiment:
    """Kelvin–Boltzmann tissue with an effect; position without noise, force with coloured noise and an offset.

    Parameters
    ----------
    known : KnownEffect
    colour : str
        Of `COLOURS`.
    seed : int
    """
    rng = np.random.default_rng([20262, KNOWN.index(known), COLOURS.index(colour), seed])
    tissue, motions = _tissue(rng), _motions(rng)
    scales, form = Scales.measure(motions[0], tissue), form_named(known.label)
    rms = log_uniform(rng, *NOISE_SHARE) * scales.force
    wanted = log_uniform(rng, *EFFECT_OVER_NOISE) * rms
    effect: HiddenEffect = calibrated(form, form.draw(rng, scales), wanted, motions[0], tissue, scales)
    zero, records = rng.normal(0.0, 0.1 * scales.force), []
    for motion in motions:
        force = motion.sampled(simulate(motion, tissue, [effect]))
        force = force + zero + rms * _unit_noise(colour, rng, len(force))
        records.append(_record(motion.record, motion.sampled(motion.position), force))
    truth = {
        ("", "spring_stiffness"): tissue.elastic,
        ("", "branch_stiffness"): tissue.relaxing,
        ("", "relaxation_time"): tissue.relaxation_s,
    }
    shape = known.truth(effect.strength, effect.shape)
    return Experiment(records, truth | {(known.effect, name): value for name, value in shape.items()})


def single_form_catalogue(known: KnownEffect) -> dict[str, Effect]:
    """Return a catalogue with only this form of the effect."""
    from dataclasses import replace

    return {known.effect: replace(CATALOGUE[known.effect], forms=(known.form,))}
