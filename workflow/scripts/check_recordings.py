"""Check of the inputs: read and describe every recording, or report all problems and write nothing."""

from job import run


def main(input, output, plan: list[dict], source_label: str):
    """Read the planned recordings and write one description per chapter."""
    from pathlib import Path

    from lumbar.base.files import write_json
    from lumbar.lifting.quality.body import read_upright
    from lumbar.records.checking import check_recordings

    # Where they are for this job: a store's objects are copied for it.
    here = [{**item, "path": path} for item, path in zip(plan, input.recordings, strict=True)]
    chapters = check_recordings(here, read_upright)
    for path in output:
        recordings = chapters[Path(path).stem]
        write_json(path, {"schema": "lumbar.checked/1", "data": source_label, "recordings": recordings})


run(main, snakemake)
