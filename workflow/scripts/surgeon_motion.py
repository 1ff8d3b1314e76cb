"""Bandwidth of the surgeons' tool motion: spectra, rules with intervals, figure."""

from job import run, stem


def main(input, output, params):
    """Read the trials, analyse them, write spectra, bandwidths and the figure."""
    from lumbar.files import write_csv, write_json
    from lumbar.records.columns import read_record
    from lumbar.reports.figures.style import save
    from lumbar.reports.figures.surgeon_figures import psd_figure
    from lumbar.settings.plain import plain, typed
    from lumbar.settings.surgeon import SurgeonSettings
    from lumbar.signals.surgeon_motion import (
        motion_bandwidths,
        motion_spectra,
        spectra_table,
    )

    settings = typed(SurgeonSettings, params.settings)
    records = [
        read_record(path, settings.layout, name=entry.name, rate=settings.rate_Hz)
        for entry, path in zip(settings.records, input.records, strict=True)
    ]
    spectra = motion_spectra(records, [entry.surgeon for entry in settings.records], settings.welch)
    bandwidths = motion_bandwidths(spectra, settings.bandwidth, params.seed)
    write_json(output.bandwidth, {**bandwidths, "welch": plain(settings.welch), "data": params.data})
    write_csv(output.psd, spectra_table(spectra).assign(data=params.data))
    figure = psd_figure(
        spectra.frequency,
        spectra.psd,
        {quantity: spectra.pooled(quantity) for quantity in spectra.psd},
        spectra.surgeons,
        bandwidths,
        settings.reference_Hz,
    )
    save(figure, stem(output.surgeon_psd), params.data)


run(main, snakemake)
