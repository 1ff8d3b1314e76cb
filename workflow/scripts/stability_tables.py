"""Table 4.1 and the areas of all basins of attraction."""

from job import run


def main(input, output, params):
    """Collect the areas of all lifts, compare them, write the tables."""
    import pandas as pd

    from lumbar.files import read_json, write_csv
    from lumbar.stability.basins import DTYPES
    from lumbar.stability.extended_basins import extended_table
    from lumbar.stability.percent_differences import areas_table, table_4_1
    from lumbar.stability.trajectory import trajectories_of_lift

    mass = params.settings["pendulum"]["mass"]
    lifts = [
        (pd.read_csv(states), read_json(facts))
        for states, facts in zip(input.states, input.facts, strict=True)
    ]
    trajectories, other_mass = (
        [item for states, facts in lifts for item in trajectories_of_lift(states, facts, counted)]
        for counted in (mass, "without_box" if mass == "with_box" else "with_box")
    )
    boa = pd.concat([pd.read_csv(path, dtype=DTYPES) for path in input.boa], ignore_index=True)
    write_csv(output.boa, boa)
    table_4_1(boa, trajectories, params.settings, params.data, other_mass, params.seed).write(
        output.table_4_1_html.removesuffix(".html")
    )
    extended = pd.concat(
        [
            pd.read_csv(path, dtype={"torque_exits": "Int64", "uncertain_mass_exits": "Int64"})
            for path in input.extended
        ],
        ignore_index=True,
    )
    extended_table(extended, params.settings, params.data).write(
        output.extended_basins_html.removesuffix(".html")
    )
    areas_table(boa, params.data).write(output.basin_areas_html.removesuffix(".html"))


run(main, snakemake)
