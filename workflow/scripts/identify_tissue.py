"""Identification of every tissue model on one training record."""

from job import run

from lumbar.settings.study_settings import StudySettings


def main(input, output, training: str, settings: StudySettings, data: str):
    """Read the records, identify the models, write fits and search grid."""
    from lumbar.base.files import write_csv, write_json
    from lumbar.interface.identification import identify
    from lumbar.interface.reading import read_listed
    from lumbar.tissue.models.fitted_model import models_document

    tissue = settings.tissue
    found = identify(
        read_listed(input.recordings, tissue.records, tissue.layout, tissue.rate_Hz),
        training,
        settings=settings,
        data=data,
    )
    write_csv(output.grid, found.search)
    write_json(output.fits, models_document(found.models, data))


run(main, snakemake)
