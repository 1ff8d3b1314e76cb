"""Diagnosis of one batch of experiments, without their labels."""

from job import run


def main(input, output, params):
    """Read the folders, diagnose each with default settings, write all diagnoses of the batch."""
    from lumbar.base.files import write_json
    from lumbar.tissue.diagnosis.selection.batch import diagnose_folders
    from lumbar.tissue.diagnosis.selection.diagnose import diagnose

    def diagnosis(records):
        return diagnose(records).to_json()

    write_json(output.diagnoses, diagnose_folders(input.recordings, diagnosis))


run(main, snakemake)
