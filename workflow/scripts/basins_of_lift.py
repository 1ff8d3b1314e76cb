"""Basins of attraction of one lift."""

from job import run


def main(input, output, params):
    """Read the pendulum states, compute and check the basins, write areas and funnels."""
    from pathlib import Path

    from lumbar.base.files import read_json
    from lumbar.interface.lift_basins import basins
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings

    settings = typed(StabilitySettings, params.settings)
    found = basins(input.states, facts=read_json(input.facts), settings=settings, seed=params.seed)
    found.save(Path(output.boa).parent)


run(main, snakemake)
