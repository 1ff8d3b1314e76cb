"""Survey of the twin: answers that fit the published margins, copied as they come with the project."""

from job import run


def main(input, output):
    """Copy the answers, whole or not at all."""
    from pathlib import Path

    from lumbar.base.files import write_text

    write_text(output.answers, Path(input.answers).read_text(encoding="utf-8"))


run(main, snakemake)
