"""FMUs of the identified models, for FMI 2.0 and 3.0."""

from job import run


def main(input, output, params):
    """Read the models, compile and pack each."""
    from pathlib import Path

    from lumbar.effects.catalogue import catalogues_with
    from lumbar.files import read_json
    from lumbar.fmu.build.compiler import cache_folder
    from lumbar.fmu.build.export_model import select_models
    from lumbar.fmu.build.package import export_fmus
    from lumbar.models.models_file import read_models
    from lumbar.settings.plain import typed
    from lumbar.settings.runtime import RuntimeSettings

    settings = typed(RuntimeSettings, params.settings)
    fitted = read_models(read_json(input.models), catalogues_with(input.effects))
    models = select_models(fitted, settings)
    folder = Path(output.fmus[0]).parent
    export_fmus(models, folder, params.data, settings.targets, cache_folder(settings.compiler_cache))


run(main, snakemake)
