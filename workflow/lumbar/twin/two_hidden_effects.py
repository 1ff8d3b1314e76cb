"""A second set of synthetic tissue tests: two effects, little noise, from the benchmark's generator."""

from __future__ import annotations

from dataclasses import replace

from lumbar.settings.hidden_effects import HiddenEffectsSettings, NoiseColours
from lumbar.settings.twin import TwinSettings
from lumbar.twin.hidden_effects.experiment import HiddenExperiment, Plan, make_experiment


def make_two_hidden_effects(twin: TwinSettings, generator: HiddenEffectsSettings) -> HiddenExperiment:
    """Make the records and the truth about them.

    Parameters
    ----------
    twin : TwinSettings
        Its seed and ``two_hidden_effects``.
    generator : HiddenEffectsSettings
        Ranges of tissues and excitations.

    Returns
    -------
    Experiment
    """
    wanted = twin.two_hidden_effects
    settings = replace(
        generator,
        seed=twin.seed,
        noise_share=(wanted.noise_share, wanted.noise_share),
        noise_colours=NoiseColours(white=1.0, autoregressive=0.0, flicker=0.0),
        residual_over_noise=(wanted.residual_over_noise, wanted.residual_over_noise),
    )
    plan = Plan("two_hidden_effects", "pair", wanted.number, wanted.mechanisms, level=0.0)
    return make_experiment(plan, settings)
