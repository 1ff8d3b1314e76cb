"""Table 3.1, physical parameters, models.json, search grid and Figures 3.4 and 3.5."""

from job import run, stem


def main(input, output, params):
    """Collect the identifications and publish them."""
    import pandas as pd

    from lumbar.effects.catalogue import catalogues_with
    from lumbar.files import read_json, write_csv, write_json
    from lumbar.identification.identify_tissue import distinct
    from lumbar.identification.table_2_1 import physical_parameters_table
    from lumbar.identification.table_3_1 import table_3_1
    from lumbar.models.fitted_model import ARX
    from lumbar.models.models_file import models_document, read_models
    from lumbar.models.tissue_models import HO, KB, MW
    from lumbar.records.columns import read_record
    from lumbar.reports.figures.style import save
    from lumbar.reports.figures.tissue_figures import comparison_figure, excitation_figure
    from lumbar.settings.plain import typed
    from lumbar.settings.tissue import TissueSettings

    tissue, data = typed(TissueSettings, params.tissue), params.data
    catalogues = catalogues_with(input.effects)
    models = [model for path in input.fits for model in read_models(read_json(path), catalogues)]
    write_json(output.models, models_document(distinct(models), data))
    write_csv(output.search, pd.concat([pd.read_csv(path) for path in input.grids]))
    table_3_1(models, tissue, data).write(stem(output.table_3_1))
    confidence = tissue.bootstrap.confidence
    physical_parameters_table(models, confidence, data).write(stem(output.physical_parameters))

    entries = {
        entry.name: (entry, path) for entry, path in zip(tissue.records, input.recordings, strict=True)
    }
    records = {}
    for name in tissue.training:
        entry, path = entries[name]
        records[name] = read_record(path, tissue.layout, name, entry.period_s, tissue.rate_Hz)
    shortest_first = sorted(records.values(), key=lambda record: (record.duration, record.name))
    save(
        excitation_figure(shortest_first, tissue.segment_s),
        stem(output.figure_3_4),
        data,
    )
    first = tissue.training[0]
    shown = [
        model
        for model in models
        if model.trained_on == first
        and model.stable
        and (not model.discrete or (model.estimator == ARX and model.name in (MW.name, KB.name, HO.name)))
    ]
    simulated = {model.name: model.simulate(records[first]) for model in shown}
    comparison = comparison_figure(records[first], simulated, tissue.segment_s)
    save(comparison, stem(output.figure_3_5), data)


run(main, snakemake)
