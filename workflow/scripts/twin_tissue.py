"""Synthetic tissue tests: the testing machine plays every signal on the synthetic tissue."""

from job import run


def main(input, output, params):
    """Play each signal file and write what the machine records."""
    from lumbar.settings.plain import typed
    from lumbar.settings.twin import SyntheticTissueSettings
    from lumbar.twin.tissue_recordings import play

    tissue = typed(SyntheticTissueSettings, params.tissue)
    for number, (signal, recording) in enumerate(zip(input.signals, output.recordings, strict=True)):
        play(signal, recording, tissue, params.seed, number)


run(main, snakemake)
