"""Bandwidth of the surgeons' tool motion: spectra, rules with intervals, figure."""

from job import run, stem


def main(input, output, params):
    """Read the trials, analyse them, write spectra, bandwidths and the figure."""
    from pathlib import Path

    from lumbar.interface.reading import read
    from lumbar.interface.surgeons import bandwidth
    from lumbar.publishing.figures.style import save
    from lumbar.settings.plain import typed
    from lumbar.settings.surgeon import SurgeonSettings

    settings = typed(SurgeonSettings, params.settings)
    trials = read(
        input.records,
        layout=settings.layout,
        rate=settings.rate_Hz,
        names=[entry.name for entry in settings.records],
    )
    surgeons = [entry.surgeon for entry in settings.records]
    found = bandwidth(trials, surgeons, settings=settings, seed=params.seed, data=params.data)
    found.save(Path(output.bandwidth).parent)
    save(found.figure(), stem(output.surgeon_psd), params.data)


run(main, snakemake)
