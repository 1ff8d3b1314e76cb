"""Pushes against simulated bodies: which measure, computed before, tells who must step."""

from job import run, stem


def main(input, output, params):
    """Read the movement of all lifts, push, score, write tables and figure."""
    from pathlib import Path

    from lumbar.files import write_csv, write_json
    from lumbar.interface.pushing import push_prediction, push_states, saved_lift
    from lumbar.pushes.prediction import verdict_json
    from lumbar.reports.figures.style import save
    from lumbar.settings.plain import typed
    from lumbar.settings.pushes import PushesSettings
    from lumbar.settings.stability import StabilitySettings

    settings, stability = typed(PushesSettings, params.settings), typed(StabilitySettings, params.stability)
    states = push_states([saved_lift(Path(path).parent) for path in input.bodies], stability, settings)
    found = push_prediction(
        states, settings=settings, stability=stability, seed=params.seed, data=params.data
    )
    write_csv(output.pushes, found.pushes.assign(data=found.data))
    write_json(output.winner, verdict_json(found.winner, found.data))
    found.table.write(stem(output.push_prediction))
    found.sensitivity.write(stem(output.push_sensitivity))
    save(found.figure(), stem(output.push_figure), params.data)


run(main, snakemake)
