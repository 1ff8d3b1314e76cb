"""Synthetic recordings of the surgeons' tool."""

from job import run

from lumbar.settings.twin import SyntheticSurgeonSettings


def main(input, output, records: list[dict], settings: SyntheticSurgeonSettings, seed: int):
    """Make every trial the study reads."""
    from lumbar.base.files import write_csv
    from lumbar.twin.surgeon_recordings import surgeon_trial

    for record, path in zip(records, output.recordings, strict=True):
        write_csv(path, surgeon_trial(record["name"], record["surgeon"], settings, seed))


run(main, snakemake)
