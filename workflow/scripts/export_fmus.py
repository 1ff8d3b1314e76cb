"""FMUs of the identified models, for FMI 2.0 and 3.0."""

from job import run

from lumbar.settings.runtime import RuntimeSettings


def main(input, output, settings: RuntimeSettings, data: str):
    """Read the models, compile and pack each."""
    from pathlib import Path

    from lumbar.interface.device import export_fmu

    export_fmu(
        input.models,
        Path(output.fmus[0]).parent,
        settings.models,
        trained_on=settings.trained_on,
        effect_files=input.effects,
        settings=settings,
        data=data,
    )


run(main, snakemake)
