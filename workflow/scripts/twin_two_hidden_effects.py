"""Synthetic tissue tests with two hidden effects."""

from job import run

from lumbar.settings.twin import TwoHiddenEffectsSettings


def main(input, output, settings: TwoHiddenEffectsSettings, seed: int):
    """Make the records and write one file each."""
    from pathlib import Path

    from lumbar.twin.two_hidden_effects import two_hidden_effects, write_records

    write_records(Path(output.recordings[0]).parent, two_hidden_effects(settings, seed))


run(main, snakemake)
