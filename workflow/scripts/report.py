"""The report of the study: one page with all tables and figures."""

from pathlib import Path

from job import run


def main(input, output):
    """Compose the page from the study's results."""
    from lumbar.interface.study_report import report

    report(Path(input.config).parent, Path(input.sheet).parents[1]).save(output.page)


run(main, snakemake)
