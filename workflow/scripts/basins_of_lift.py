"""Basins of attraction of one lift."""

from job import run


def main(input, output, params):
    """Read the pendulum states, compute and check the basins, write areas and funnels."""
    import pandas as pd

    from lumbar.files import read_json, write_csv
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
    from lumbar.stability.basins import basins_of_lift
    from lumbar.stability.extended_basins import extended_basins
    from lumbar.stability.model.failures import failures_frame
    from lumbar.stability.model.lift_trajectories import trajectories_of_lift

    settings = typed(StabilitySettings, params.settings)
    mass = settings.pendulum.mass
    trajectories, failures = trajectories_of_lift(pd.read_csv(input.states), read_json(input.facts), mass)
    basins = basins_of_lift(trajectories, settings, params.seed)
    write_csv(output.boa, basins.summary)
    write_csv(output.funnel, basins.funnels)
    extended, not_extended = extended_basins(trajectories, settings, params.seed)
    write_csv(output.extended, extended)
    write_csv(output.failures, failures_frame([*failures, *basins.failures, *not_extended]))


run(main, snakemake)
