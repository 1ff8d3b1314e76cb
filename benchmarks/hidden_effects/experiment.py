"""One experiment: a tissue, its excitation, its hidden effects and the noise, all drawn from one seed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hidden_effects.catalogue import OUTSIDE_FORMS, PAIRS, SINGLE, form_named, forms_of
from hidden_effects.form import OUTSIDE, Scales, calibrated, simulate
from hidden_effects.noise import draw_noise
from hidden_effects.settings import HiddenEffectsSettings
from lumbar.base.files import write_json
from lumbar.twin.two_hidden_effects import RATE_HZ, ToolMotion, draw_test, residual_rms, write_records

KINDS = ("single", "pair", OUTSIDE, "null")
"""One effect of the catalogue; two; one that the catalogue does not hold; none."""
_GOLDEN = 0.6180339887498949
"""Multiples of it modulo 1 fill the range of strengths evenly for any number of repeats."""


@dataclass(frozen=True)
class Plan:
    """Plan of an experiment."""

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
    """Truth, as in ``labels.json``."""


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
    tissue, motions = draw_test(rng, settings)
    noise = _draw_noise_settings(rng, settings)
    multisine = motions["multisine"]
    scales = Scales.measure(multisine, tissue)
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
    residuals = [residual_rms(multisine, simulate(multisine, tissue, [effect])) for effect in effects]
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


def _draw_noise_settings(rng: np.random.Generator, settings: HiddenEffectsSettings) -> dict:
    """Share, colour and correlation of an experiment's noise, in the ranges of the settings."""
    colours = settings.noise_colours
    return {
        "share": float(rng.uniform(*settings.noise_share)),
        "colour": str(rng.choice(list(colours), p=np.array(list(colours.values())) / sum(colours.values()))),
        "correlation": float(rng.uniform(*settings.autoregressive_correlation)),
    }


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


def write_experiments(
    folder: str | os.PathLike, labels: str | os.PathLike, plans: list[Plan], settings: HiddenEffectsSettings
) -> None:
    """Make experiments and write their recordings, one folder each, and, apart, the truth as JSON by experiment."""
    truth = {}
    for plan in plans:
        experiment = make_experiment(plan, settings)
        write_records(Path(folder) / plan.name, experiment.records)
        truth[plan.name] = experiment.label
    write_json(labels, truth)
