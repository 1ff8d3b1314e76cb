"""Excitation signals of the tissue tests: files for the testing machine, their properties, figure."""

from job import run, stem

from lumbar.settings.tissue import SignalsSettings


def main(input, output, settings: SignalsSettings, seed: int, source_label: str):
    """Design the signals from the surgeons' bandwidth, check them against the machine, write them."""
    from pathlib import Path

    from lumbar.interface.surgeons import design_signals
    from lumbar.publishing.figures.style import save

    result = design_signals(input.bandwidth, settings=settings, seed=seed, source_label=source_label)
    result.save(Path(output.properties).parent)
    result.table.write(stem(output.signal_properties))
    save(result.figure(), stem(output.excitation_signals), source_label)


run(main, snakemake)
