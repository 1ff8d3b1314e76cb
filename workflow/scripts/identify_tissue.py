"""Identification of the tissue models: Table 3.1, physical parameters, models.json, search grid and Figures 3.4 and 3.5."""

from job import run, stem

from lumbar.settings.study_settings import StudySettings


def main(input, output, settings: StudySettings, source_label: str):
    """Read the records, identify every model on every training record and publish the models."""
    from lumbar.interface.identification import identify
    from lumbar.interface.reading import read_listed
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.tissue_figures import record_segments_figure

    tissue = settings.tissue
    records = read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz)
    result = identify(records, tissue.training, settings=settings, source_label=source_label)
    result.write(
        {
            "models.json": output.models,
            "search.csv": output.search,
            "table_3_1": stem(output.table_3_1),
            "physical_parameters": stem(output.physical_parameters),
        }
    )
    trained = sorted((records[name] for name in tissue.training), key=lambda item: (item.duration, item.name))
    save(record_segments_figure(trained, tissue.segment_s), stem(output.figure_3_4), source_label)
    save(result.free_run_figure(records[tissue.training[0]]), stem(output.figure_3_5), source_label)


run(main, snakemake)
