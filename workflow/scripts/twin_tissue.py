"""Synthetic tissue tests: the testing machine plays every signal on the synthetic tissue."""

from job import run

from lumbar.settings.twin import SyntheticTissueSettings


def main(input, output, tissue: SyntheticTissueSettings, seed: int):
    """Play each signal file and write what the machine records."""
    from lumbar.twin.tissue_recordings import play

    for number, (signal, recording) in enumerate(zip(input.signals, output.recordings, strict=True)):
        play(signal, recording, tissue, seed, number)


run(main, snakemake)
