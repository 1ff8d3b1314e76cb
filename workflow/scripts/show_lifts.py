"""An interactive page of every lift, with pushes against the funnel."""

from job import run

from lumbar.settings.lifting import StabilitySettings


def main(input, output, settings: StabilitySettings, source_label: str):
    """Make every lift's page from the folder that the lift was written to."""
    from pathlib import Path

    from lumbar.interface.lift_page import lift_page

    for events, page in zip(input.events, output.lift_pages, strict=True):
        lift_page(Path(events).parent, settings=settings, source_label=source_label).save(page)


run(main, snakemake)
