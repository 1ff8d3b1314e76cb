"""Bandwidth of the surgeons' tool motion: spectra, rules with intervals, figure."""

from job import run, stem

from lumbar.settings.tissue import SurgeonSettings


def main(input, output, settings: SurgeonSettings, seed: int, source_label: str):
    """Read the trials, analyse them, write spectra, bandwidths and the figure."""
    from pathlib import Path

    from lumbar.interface.reading import read
    from lumbar.interface.surgeons import bandwidth
    from lumbar.publishing.figures.style import save

    trials = read(
        input.records,
        layout=settings.layout,
        rate=settings.rate_Hz,
        names=[entry.name for entry in settings.records],
    )
    surgeons = [entry.surgeon for entry in settings.records]
    result = bandwidth(trials, surgeons, settings=settings, seed=seed, source_label=source_label)
    result.save(Path(output.bandwidth).parent)
    save(result.figure(), stem(output.surgeon_psd), source_label)


run(main, snakemake)
