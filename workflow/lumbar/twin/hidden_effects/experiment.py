"""One experiment: a tissue, its excitation, its hidden effects and the noise, all drawn from one seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lumbar.base.errors import Problems
from lumbar.twin.hidden_effects.force_simulation import calibrated, residual_rms, simulate
from lumbar.twin.hidden_effects.hidden_catalogue import (
    OUTSIDE_FORMS,
    PAIRS,
    SINGLE,
    form_named,
    forms_of,
)
from lumbar.twin.hidden_effects.hidden_form import OUTSIDE, Scales, log_uniform
from lumbar.twin.hidden_effects.hidden_tissue import Tissue
from lumbar.twin.hidden_effects.load_cell_noise import draw_noise
from lumbar.twin.hidden_effects.tool_motion import RATE_HZ, ToolMotion, draw_motions

if TYPE_CHECKING:
    from lumbar.settings.hidden_effects import HiddenEffectsSettings

KINDS = ("single", "pair", OUTSIDE, "null")
"""One effect of the catalogue; two; one that the catalogue does not hold; none."""
_GOLDEN = 0.6180339887498949
"""Multiples of it modulo 1 fill the range of strengths evenly for any number of repeats."""


@dataclass(frozen=True)
class Plan:
    """What an experiment will hold."""

    name: str
    """Folder, e.g. ``"single_0007"``: the kind and the number that seeds it."""
    kind: str
    """One of `KINDS`."""
    number: int
    """Counts the experiments of the kind; those of a smaller benchmark are the first of a larger one."""
    forms: tuple[str, ...]
    """Labels of the forms; a pair names its mechanisms, whose forms are drawn."""
    level: float
    """Place in the range of residuals over noise, 0 … 1 in the logarithm."""


@dataclass(frozen=True)
class HiddenExperiment:
    """Recordings and the truth about them."""

    records: dict[str, np.ndarray]
    """Shape (samples, 3): time (s), position (mm), force (N) by record name."""
    label: dict
    """Truth, as it stands in ``labels.json``."""


def check_settings(settings: HiddenEffectsSettings) -> None:
    """Check what the schema cannot: ranges that run upward, and that some colour of noise occurs.

    Raises
    ------
    InputError
        With every wrong key.
    """
    problems = Problems("configuration: hidden_effects")
    for key, value in vars(settings).items():
        if isinstance(value, tuple) and value[0] > value[1]:
            problems.add(key, f"[{value[0]:g}, {value[1]:g}]", "the smaller value comes first")
    if sum(vars(settings.noise_colours).values()) <= 0:
        problems.add("noise_colours", "all weights are 0", "at least one colour must occur")
    problems.raise_if_any()


def plan_batch(kind: str, part: int, settings: HiddenEffectsSettings) -> list[Plan]:
    """List the experiments of one batch.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    part : int
        Number of the batch. ``slices`` batches together hold each form, or each pair, once; a batch of nulls
        holds ``nulls_per_batch`` or what is left of ``nulls``.
    """
    if kind == "null":
        first = part * settings.nulls_per_batch
        numbers = range(first, min(first + settings.nulls_per_batch, settings.nulls))
        return [_plan(kind, number, ()) for number in numbers]
    repeat, part_of_repeat = divmod(part, settings.slices)
    chosen = {
        "single": [(form.label,) for form in SINGLE],
        "pair": list(PAIRS),
        OUTSIDE: [(form.label,) for form in OUTSIDE_FORMS],
    }[kind]
    picked = range(part_of_repeat, len(chosen), settings.slices)
    return [_plan(kind, repeat * len(chosen) + index, chosen[index]) for index in picked]


def _plan(kind: str, number: int, forms: tuple[str, ...]) -> Plan:
    return Plan(f"{kind}_{number:04d}", kind, number, forms, ((number + 0.5) * _GOLDEN) % 1.0)


def make_experiment(plan: Plan, settings: HiddenEffectsSettings) -> HiddenExperiment:
    """Draw and simulate one experiment; depends on the seed and the plan alone, not on other experiments."""
    rng = np.random.default_rng([settings.seed, KINDS.index(plan.kind), plan.number])
    tissue, motions, noise = _draw_setting(rng, settings)
    multisine = motions["multisine"]
    scales = Scales.of(multisine, tissue)
    noise_rms = noise.pop("share") * scales.force
    low, high = settings.residual_over_noise
    wanted = noise_rms * low * (high / low) ** plan.level
    effects = [
        calibrated(form, form.draw(rng, scales), wanted, multisine, tissue, scales)
        for form in _chosen_forms(rng, plan)
    ]
    records = {
        name: _recorded(motion, simulate(motion, tissue, effects), noise_rms, noise, rng)
        for name, motion in motions.items()
    }
    residuals = [residual_rms(multisine, tissue, [effect]) for effect in effects]
    label = {
        "effects": [effect.form.mechanism for effect in effects],
        "form": [effect.form.label for effect in effects],
        "severity": residuals[0] / scales.force if residuals else 0.0,
        "residual_over_noise": [residual / noise_rms for residual in residuals],
        "noise_rms_N": noise_rms,
        "ke": tissue.elastic,
        "k2": tissue.relaxing,
        "tau_s": tissue.relaxation_s,
        "amplitude_mm": scales.amplitude,
        "strengths": [effect.strength for effect in effects],
        "shape": [effect.shape for effect in effects],
        "kind": plan.kind,
        "noise_colour": noise["colour"],
    }
    return HiddenExperiment(records, label)


def _draw_setting(
    rng: np.random.Generator, settings: HiddenEffectsSettings
) -> tuple[Tissue, dict[str, ToolMotion], dict]:
    """Tissue, motions and noise of an experiment, in the ranges of the configuration."""
    elastic = rng.uniform(*settings.elastic_N_per_mm)
    relaxing = float(
        np.clip(elastic * rng.uniform(*settings.relaxing_over_elastic), *settings.relaxing_N_per_mm)
    )
    tissue = Tissue(float(elastic), relaxing, log_uniform(rng, *settings.relaxation_s))
    motions = draw_motions(
        rng,
        peak_mm=float(rng.uniform(*settings.amplitude_mm)),
        slope=float(rng.choice([0.0, -0.5])),
        schroeder=bool(rng.integers(2)),
        periods=settings.periods,
    )
    colours = vars(settings.noise_colours)
    noise = {
        "share": float(rng.uniform(*settings.noise_share)),
        "colour": str(rng.choice(list(colours), p=np.array(list(colours.values())) / sum(colours.values()))),
        "correlation": float(rng.uniform(*settings.autoregressive_correlation)),
    }
    return tissue, motions, noise


def _chosen_forms(rng: np.random.Generator, plan: Plan) -> list:
    if plan.kind == "pair":
        return [forms_of(mechanism)[rng.integers(len(forms_of(mechanism)))] for mechanism in plan.forms]
    return [form_named(label) for label in plan.forms]


def _recorded(
    motion: ToolMotion, force: np.ndarray, noise_rms: float, noise: dict, rng: np.random.Generator
) -> np.ndarray:
    position, clean = motion.sampled(motion.position), motion.sampled(force)
    added = draw_noise(rng, len(clean), noise_rms, noise["colour"], noise["correlation"], RATE_HZ)
    return np.column_stack([np.arange(len(clean)) / RATE_HZ, position, clean + added])
