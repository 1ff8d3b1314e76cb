"""Table 4.1, its controls and parts, the areas of all basins, Figures 4.3 and 4.4 and the methods compared."""

from job import run, stem

from lumbar.settings.lifting import StabilitySettings


def main(input, output, settings: StabilitySettings, labels: dict[str, str], source_label: str):
    """Collect the areas of all lifts, compare them, write tables and figures, and report missing areas."""
    import sys

    import pandas as pd

    from lumbar.base.files import read_json, write_csv
    from lumbar.lifting.stability.basins import DTYPES, areas_table
    from lumbar.lifting.stability.changed_pendulums import decomposition_table
    from lumbar.lifting.stability.funnel.eqs_4_5_to_4_7_in_cvxpy import cross_check
    from lumbar.lifting.stability.model.pendulum_trajectories import (
        THESIS,
        LiftStates,
        announcement,
        failures_frame,
        failures_table,
        join_rows,
    )
    from lumbar.lifting.stability.percent_differences import ComparedLifts
    from lumbar.lifting.stability.table_4_1 import alternations_table, tables_4_1

    facts = [read_json(path) for path in input.facts]
    lifts = [
        LiftStates(
            pd.read_csv(states), {**known, "experience": labels[known["subject"]]}, pd.read_csv(thesis)
        )
        for states, thesis, known in zip(input.states, input.thesis, facts, strict=True)
    ]
    boa, failures = (
        join_rows([pd.read_csv(path, dtype=DTYPES if name == "boa" else None) for path in input[name]])
        for name in ("boa", "failures")
    )
    boa, failures = (frame.assign(experience=frame["subject"].map(labels)) for frame in (boa, failures))
    study = ComparedLifts(lifts, boa, settings, pd.read_csv(input.published), source_label)
    boa, disagreements = cross_check(boa, study.trajectories(convention=THESIS), settings)
    failures = join_rows([failures, failures_frame(disagreements)])
    parts, without = decomposition_table(study)
    failures = join_rows([failures, failures_frame(without)])
    tables = tables_4_1(study, parts.frame, failures)
    failures = tables.missing
    if "thesis_method" in settings.checks:
        alternations_table(study).write(stem(output.table_4_1_alternations))
    write_csv(output.boa, boa)
    write_csv(output.failures, failures)
    tables.table.write(stem(output.table_4_1))
    tables.controls.write(stem(output.table_4_1_controls))
    parts.write(stem(output.table_4_1_parts))
    areas_table(boa, settings, source_label).write(stem(output.basin_areas))
    failures_table(failures, source_label).write(stem(output.missing_basins))
    if len(failures):
        print(f"WARNING: {announcement(failures, len(boa), output.failures)}", file=sys.stderr)
    _draw(input, output, facts, settings, labels, source_label)


def _draw(
    input, output, facts: list[dict], settings: StabilitySettings, labels: dict[str, str], source_label: str
):
    """Choose the lift of the figures, read its funnels, draw the figures."""
    import pandas as pd

    from lumbar.lifting.stability.model.pendulum_trajectories import trajectories_of_lift
    from lumbar.publishing.figures.stability_figures import (
        figure_4_3,
        figure_4_4,
        method_comparison_figure,
        select_lift,
    )
    from lumbar.publishing.figures.style import person_and_box, save

    chosen = select_lift(facts, labels, settings.compare.groups[0])
    funnels, states = pd.read_csv(input.funnels[chosen]), pd.read_csv(input.states[chosen])
    person, pendulum = person_and_box(facts[chosen]), settings.pendulum
    save(figure_4_3(funnels, settings), stem(output.figure_4_3), source_label, who=person)
    save(figure_4_4(funnels, settings), stem(output.figure_4_4), source_label, who=person)
    trajectories, _ = trajectories_of_lift(states, facts[chosen], pendulum.mass, pendulum.time)
    who = f"{person}, {pendulum.sign}, {pendulum.time} time"
    comparison = method_comparison_figure(trajectories, funnels, settings, who)
    save(comparison, stem(output.basin_comparison), source_label, who=person)


run(main, snakemake)
