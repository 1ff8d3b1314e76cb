"""FMUs of the identified models, for FMI 2.0 and 3.0, their checks, and their forces for one push."""

from job import run, stem

from lumbar.settings.runtime import RuntimeSettings


def main(input, output, settings: RuntimeSettings, seed: int, source_label: str):
    """Compile and pack every model, validate and simulate every FMU; write the table of checks and the figure of forces."""
    from pathlib import Path

    from lumbar.base.files import write_csv
    from lumbar.interface.device import export_fmu, load_models
    from lumbar.publishing.figures.runtime_figures import fmu_force_figure
    from lumbar.publishing.figures.style import save
    from lumbar.tissue.fmu.build.export_model import export_models, find_models
    from lumbar.tissue.fmu.fmu_check import check_fmus, check_table, push

    folder = Path(output.fmus[0]).parent
    fitted = load_models(input.models, input.effects)
    export_fmu(
        input.models,
        folder,
        settings.models,
        trained_on=settings.trained_on,
        effect_files=input.effects,
        settings=settings,
        source_label=source_label,
    )
    models = export_models(find_models(fitted, settings), settings)
    table = check_table(check_fmus(models, folder, settings.check_samples, seed), source_label, seed)
    write_csv(output.checks, table.frame)
    table.write(stem(output.fmu_check))
    played = push(models, folder)
    figure = fmu_force_figure(
        played.time,
        played.inputs,
        played.outputs,
        played.most_delayed,
        models[0].input.label,
        models[0].output.label,
    )
    save(figure, stem(output.fmu_force), source_label)


run(main, snakemake)
