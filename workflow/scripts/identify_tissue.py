"""Identification of every tissue model on one training record."""

from job import run


def main(input, output, params):
    """Read the records, identify the models, write fits and search grid."""
    from lumbar.base.files import write_csv, write_json
    from lumbar.interface.identification import identify
    from lumbar.interface.reading import read_listed
    from lumbar.settings.plain import typed
    from lumbar.settings.study_settings import StudySettings
    from lumbar.tissue.models.models_file import models_document

    settings = typed(StudySettings, params.settings, complete=False)
    tissue = settings.tissue
    found = identify(
        read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz),
        params.training,
        settings=settings,
        data=params.data,
    )
    write_csv(output.grid, found.search)
    write_json(output.fits, models_document(found.models, params.data))


run(main, snakemake)
