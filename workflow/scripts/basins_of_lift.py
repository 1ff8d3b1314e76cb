"""Basins of attraction of one lift."""

from job import run

from lumbar.settings.lifting import StabilitySettings


def main(input, output, settings: StabilitySettings, seed: int):
    """Read the pendulum states, compute and check the basins, write areas and funnels."""
    from pathlib import Path

    from lumbar.base.files import read_json
    from lumbar.interface.lift_basins import basins

    result = basins(input.states, facts=read_json(input.facts), settings=settings, seed=seed)
    result.save(Path(output.boa).parent)


run(main, snakemake)
