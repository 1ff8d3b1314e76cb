"""An interactive page of every lift, with pushes against the funnel."""

from job import run

from lumbar.settings.lifting import StabilitySettings


def main(input, output, settings: StabilitySettings, source_label: str):
    """Make the page of every lift from the folder with its results."""
    from pathlib import Path

    from lumbar.interface.lift_page import lift_page

    for events, page in zip(input.events, output.lift_pages, strict=True):
        lift_page(Path(events).parent, settings=settings, source_label=source_label).save(page)


run(main, snakemake)
