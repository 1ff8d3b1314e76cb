"""A second set of synthetic tissue tests: two effects, little noise, from the benchmark's generator."""

from __future__ import annotations

from lumbar.synthetic.hidden_effects.experiment import HiddenExperiment, Plan, make_experiment


def make_two_hidden_effects(twin: dict, generator: dict) -> HiddenExperiment:
    """Make the records and the truth about them.

    Parameters
    ----------
    twin : dict
        Section ``twin`` of the configuration: its seed and ``two_hidden_effects``.
    generator : dict
        Section ``hidden_effects``: ranges of tissues and excitations.

    Returns
    -------
    Experiment
    """
    wanted = twin["two_hidden_effects"]
    settings = {
        **generator,
        "seed": twin["seed"],
        "noise_share": [wanted["noise_share"]] * 2,
        "noise_colours": {"white": 1},
        "residual_over_noise": [wanted["residual_over_noise"]] * 2,
    }
    plan = Plan("two_hidden_effects", "pair", wanted["number"], tuple(wanted["mechanisms"]), level=0.0)
    return make_experiment(plan, settings)
