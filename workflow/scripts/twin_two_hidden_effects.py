"""Synthetic tissue tests with two hidden effects."""

from job import run


def main(input, output, params):
    """Make the records and write one file each."""
    from pathlib import Path

    from lumbar.settings.hidden_effects import HiddenEffectsSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.twin import TwinSettings
    from lumbar.twin.hidden_effects.experiment_folder import write_experiment
    from lumbar.twin.two_hidden_effects import make_two_hidden_effects

    experiment = make_two_hidden_effects(
        typed(TwinSettings, params.twin), typed(HiddenEffectsSettings, params.generator)
    )
    write_experiment(Path(output.recordings[0]).parent, experiment)


run(main, snakemake)
