"""Table 4.1 and the areas of all basins of attraction."""

from job import run


def main(input, output, params):
    """Collect the areas of all lifts, compare them, write the tables."""
    import pandas as pd

    from lumbar.files import read_json, write_csv
    from lumbar.stability.basins import DTYPES
    from lumbar.stability.percent_differences import areas_table, table_4_1
    from lumbar.stability.trajectory import trajectories_of_lift

    mass = params.settings["pendulum"]["mass"]
    trajectories = [
        trajectory
        for states, facts in zip(input.states, input.facts, strict=True)
        for trajectory in trajectories_of_lift(pd.read_csv(states), read_json(facts), mass)
    ]
    boa = pd.concat([pd.read_csv(path, dtype=DTYPES) for path in input.boa], ignore_index=True)
    write_csv(output.boa, boa)
    table_4_1(boa, trajectories, params.settings, params.data).write(
        output.table_4_1_html.removesuffix(".html")
    )
    areas_table(boa, params.data).write(output.basin_areas_html.removesuffix(".html"))


run(main, snakemake)
