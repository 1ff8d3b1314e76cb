"""Excitation signals of the tissue tests: files for the testing machine, their properties, figure."""

from job import run, stem


def main(input, output, params):
    """Design the signals from the surgeons' bandwidth, check them against the machine, write them."""
    from pathlib import Path

    from lumbar.interface.surgeons import design_signals
    from lumbar.publishing.figures.style import save
    from lumbar.settings.plain import typed
    from lumbar.settings.signals import SignalsSettings

    settings = typed(SignalsSettings, params.settings)
    found = design_signals(input.bandwidth, settings=settings, seed=params.seed, data=params.data)
    found.save(Path(output.properties).parent)
    found.properties.write(stem(output.signal_properties))
    save(found.figure(), stem(output.excitation_signals), params.data)


run(main, snakemake)
