"""Figures 4.3 and 4.4: basins of attraction around the trajectories of one lift, and the methods compared."""

from job import run, stem

from lumbar.settings.stability import StabilitySettings


def main(input, output, settings: StabilitySettings, labels: dict[str, str], data: str):
    """Choose the lift shown, read its funnels, draw."""
    import pandas as pd

    from lumbar.base.files import read_json
    from lumbar.lifting.stability.model.trajectories import trajectories_of_lift
    from lumbar.publishing.figures.stability_figures import (
        comparison_figure,
        figure_4_3,
        figure_4_4,
        shown_lift,
    )
    from lumbar.publishing.figures.style import person_and_box, save

    facts = [read_json(path) for path in input.facts]
    chosen = shown_lift(facts, labels, settings.compare.groups[0])
    funnels = pd.read_csv(input.funnels[chosen])
    person, pendulum = person_and_box(facts[chosen]), settings.pendulum
    save(figure_4_3(funnels, settings), stem(output.figure_4_3), data, who=person)
    save(figure_4_4(funnels, settings), stem(output.figure_4_4), data, who=person)
    states = pd.read_csv(input.states[chosen])
    trajectories, _ = trajectories_of_lift(
        states, facts[chosen], settings.pendulum.mass, settings.pendulum.time
    )
    who = f"{person}, {pendulum.sign}, {pendulum.time} time"
    comparison = comparison_figure(trajectories, funnels, settings, who)
    save(comparison, stem(output.basin_comparison), data, who=person)


run(main, snakemake)
