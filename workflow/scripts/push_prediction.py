"""Pushes of all people against what every measure said before: which tells who must step."""

from job import run, stem

from lumbar.settings.pushes import PushesSettings


def main(input, output, settings: PushesSettings, seed: int, data: str):
    """Score the pushes of all, write tables and figure."""
    from lumbar.base.files import write_csv, write_json
    from lumbar.interface.pushing import pooled_prediction
    from lumbar.lifting.pushes.prediction import verdict_json
    from lumbar.publishing.figures.style import save

    found = pooled_prediction(input.outcomes, input.states, settings, seed, data)
    write_csv(output.pushes, found.pushes.assign(data=found.data))
    write_json(output.winner, verdict_json(found.winner, found.data))
    found.table.write(stem(output.push_prediction))
    found.sensitivity.write(stem(output.push_sensitivity))
    save(found.figure(), stem(output.push_figure), data)


run(main, snakemake)
