"""FMUs of the identified models, for FMI 2.0 and 3.0."""

from job import run


def main(input, output, params):
    """Read the models, compile and pack each."""
    from pathlib import Path

    from lumbar.interface.device import export_fmu
    from lumbar.settings.plain import typed
    from lumbar.settings.runtime import RuntimeSettings

    settings = typed(RuntimeSettings, params.settings)
    export_fmu(
        input.models,
        Path(output.fmus[0]).parent,
        settings.models,
        trained_on=settings.trained_on,
        effect_files=input.effects,
        settings=settings,
        data=params.data,
    )


run(main, snakemake)
