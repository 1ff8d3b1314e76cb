"""Synthetic recordings of the surgeons' tool."""

from job import run


def main(input, output, params):
    """Make every trial the study reads."""
    from lumbar.base.files import write_csv
    from lumbar.settings.plain import typed
    from lumbar.settings.twin import SyntheticSurgeonSettings
    from lumbar.twin.surgeon_recordings import surgeon_trial

    settings = typed(SyntheticSurgeonSettings, params.settings)
    for record, path in zip(params.records, output.recordings, strict=True):
        write_csv(path, surgeon_trial(record["name"], record["surgeon"], settings, params.seed))


run(main, snakemake)
