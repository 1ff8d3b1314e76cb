"""Table 3.1, physical parameters, models.json, search grid and Figures 3.4 and 3.5."""

from job import run


def main(input, output, params):
    """Collect the identifications and publish them."""
    import pandas as pd

    from lumbar.files import read_json, write_csv, write_json
    from lumbar.identification.identify_tissue import ARX
    from lumbar.identification.models_file import models_document, simulate_models
    from lumbar.identification.table_2_1 import physical_parameters_table
    from lumbar.identification.table_3_1 import table_3_1
    from lumbar.models.tissue_models import HO, KB, MW
    from lumbar.records.columns import read_record
    from lumbar.reports.figures.style import save
    from lumbar.reports.figures.tissue_figures import comparison_figure, excitation_figure
    from lumbar.settings.plain import typed
    from lumbar.settings.tissue import TissueSettings

    tissue, data = typed(TissueSettings, params.tissue), params.data
    identified = [read_json(path) for path in input.fits]
    document = models_document(identified)
    write_json(output.models, {**document, "data": data})
    write_csv(output.search, pd.concat([pd.read_csv(path) for path in input.grids]))
    table_3_1(identified, tissue, data).write(output.csv.removesuffix(".csv"))
    confidence = tissue.bootstrap.confidence
    physical_parameters_table(identified, confidence, data).write(output.parameters_csv.removesuffix(".csv"))

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
        output.excitation_svg.removesuffix(".svg"),
        data,
    )
    first = tissue.training[0]
    simulated = simulate_models(document, records[first], (MW.name, KB.name, HO.name), first, ARX)
    if params.effects:
        from lumbar.diagnosis.selection.refined_model import simulate_entry
        from lumbar.effects.catalogue import catalogue_with

        refined = next(
            item for item in document["models"] if "effects" in item and item["trained_on"] == first
        )
        simulated[refined["name"]] = simulate_entry(refined, records[first], catalogue_with(input.effects))
    comparison = comparison_figure(records[first], simulated, tissue.segment_s)
    save(comparison, output.comparison_svg.removesuffix(".svg"), data)


run(main, snakemake)
