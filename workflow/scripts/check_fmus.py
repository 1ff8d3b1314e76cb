"""Checks of the FMUs, and the forces that they give to one push."""

from job import run, stem

from lumbar.settings.runtime import RuntimeSettings


def main(input, output, settings: RuntimeSettings, seed: int, data: str):
    """Validate and simulate every FMU; write the table of checks and the figure of forces."""
    from pathlib import Path

    from lumbar.base.files import read_json, write_csv
    from lumbar.publishing.figures.runtime_figures import fmu_force_figure
    from lumbar.publishing.figures.style import save
    from lumbar.tissue.effects.catalogue import catalogues_with
    from lumbar.tissue.fmu.build.export_model import export_models, find_models
    from lumbar.tissue.fmu.fmu_check import check_fmus, check_table, push
    from lumbar.tissue.models.fitted_model import read_models

    content = read_json(input.models)
    fitted = read_models(content, catalogues_with(input.effects, content))
    models = export_models(find_models(fitted, settings), settings)
    folder = Path(input.fmus[0]).parent
    table = check_table(check_fmus(models, folder, settings.check_samples, seed), data, seed)
    write_csv(output.checks, table.frame)
    table.write(stem(output.fmu_check))
    played = push(models, folder)
    figure = fmu_force_figure(
        played.time,
        played.inputs,
        played.outputs,
        played.most_delayed(),
        models[0].input.label,
        models[0].output.label,
    )
    save(figure, stem(output.fmu_force), data)


run(main, snakemake)
