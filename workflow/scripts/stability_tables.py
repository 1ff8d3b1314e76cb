"""Table 4.1 and the areas of all basins of attraction."""

from job import run, stem


def main(input, output, params):
    """Collect the areas of all lifts, compare them, write the tables and name what is missing."""
    import sys

    import pandas as pd

    from lumbar.files import read_json, write_csv
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
    from lumbar.stability.basins import DTYPES
    from lumbar.stability.comparison.basin_areas import areas_table
    from lumbar.stability.comparison.cross_check import cross_checked
    from lumbar.stability.comparison.table_4_1 import table_4_1
    from lumbar.stability.extended_basins import COUNTS, extended_table
    from lumbar.stability.model.failures import announcement, failures_frame, failures_table, joined
    from lumbar.stability.model.lift_trajectories import trajectories_of_lift

    settings = typed(StabilitySettings, params.settings)
    mass, labels = settings.pendulum.mass, params.labels

    def labelled(facts):
        return {**facts, "experience": labels[facts["subject"]]}

    lifts = [
        (pd.read_csv(states), labelled(read_json(facts)))
        for states, facts in zip(input.states, input.facts, strict=True)
    ]
    trajectories, other_mass = (
        [item for states, facts in lifts for item in trajectories_of_lift(states, facts, counted)[0]]
        for counted in (mass, "without_box" if mass == "with_box" else "with_box")
    )
    boa = joined([pd.read_csv(path, dtype=DTYPES) for path in input.boa])
    failures = joined([pd.read_csv(path) for path in input.failures])
    boa, failures = (frame.assign(experience=frame["subject"].map(labels)) for frame in (boa, failures))
    boa, disagreements = cross_checked(boa, trajectories, settings)
    failures = joined([failures, failures_frame(disagreements)])
    table, failures = table_4_1(boa, trajectories, settings, params.data, other_mass, params.seed, failures)
    extended = joined([pd.read_csv(path, dtype=COUNTS) for path in input.extended])
    write_csv(output.boa, boa)
    write_csv(output.failures, failures)
    table.write(stem(output.table_4_1))
    extended_table(extended, settings, params.data).write(stem(output.extended_basins))
    areas_table(boa, params.data).write(stem(output.basin_areas))
    failures_table(failures, params.data).write(stem(output.missing_basins))
    if len(failures):
        print(announcement(output.failures), file=sys.stderr)


run(main, snakemake)
