"""Synthetic tissue tests with two hidden effects."""

from job import run


def main(input, output, params):
    """Make the records and write one file each."""
    from pathlib import Path

    from lumbar.settings.plain import typed
    from lumbar.settings.twin import TwoHiddenEffectsSettings
    from lumbar.twin.two_hidden_effects import two_hidden_effects, write_records

    records = two_hidden_effects(typed(TwoHiddenEffectsSettings, params.settings), params.seed)
    write_records(Path(output.recordings[0]).parent, records)


run(main, snakemake)
