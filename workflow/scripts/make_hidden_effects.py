"""One batch of experiments with a hidden effect."""

from job import run


def main(input, output, params):
    """Make the recordings and, apart from them, the truth."""
    from lumbar.settings.hidden_effects import HiddenEffectsSettings
    from lumbar.settings.plain import typed
    from lumbar.twin.hidden_effects.experiment import plan_batch
    from lumbar.twin.hidden_effects.experiment_folder import write_experiments

    settings = typed(HiddenEffectsSettings, params.settings)
    plans = plan_batch(params.kind, params.part, settings)
    write_experiments(output.recordings, output.labels, plans, settings)


run(main, snakemake)
