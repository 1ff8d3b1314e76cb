"""Excitation signals of the tissue tests: files for the testing machine, their properties, figure."""

from job import run, stem


def main(input, output, params):
    """Design the signals from the surgeons' bandwidth, check them against the machine, write them."""
    from lumbar.files import read_json, write_csv, write_json
    from lumbar.reports.figures.signal_figures import excitation_figure
    from lumbar.reports.figures.style import save
    from lumbar.settings.plain import typed
    from lumbar.settings.signals import SignalsSettings
    from lumbar.signals.excitation import design_excitation, excited_band
    from lumbar.signals.signal_properties import machine_file, multisine_description, signal_properties

    settings = typed(SignalsSettings, params.settings)
    band = excited_band(read_json(input.bandwidth), settings)
    excitation = design_excitation(band, settings, params.seed)
    for signal in excitation.signals:
        write_csv(output[signal.name], machine_file(signal))
    write_json(output.description, {**multisine_description(excitation, settings), "data": params.data})
    table = signal_properties(excitation, params.data)
    write_csv(output.properties, table.frame.assign(data=params.data))
    table.write(stem(output.signal_properties))
    save(excitation_figure(excitation.signals, band), stem(output.excitation_signals), params.data)


run(main, snakemake)
