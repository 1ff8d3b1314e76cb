"""A page of every lift to look around in, with pushes against the funnel."""

from job import run


def main(input, output, params):
    """Make every lift's page from the folder that the lift was written to."""
    from pathlib import Path

    from lumbar.interface.lift_page import lift_page
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings

    settings = typed(StabilitySettings, params.settings)
    for events, page in zip(input.events, output.lift_pages, strict=True):
        lift_page(Path(events).parent, settings=settings, data=params.data).save(page)


run(main, snakemake)
