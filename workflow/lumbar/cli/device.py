"""Commands that bring models to a haptic device: ``lumbar render`` and ``export``."""

from lumbar.cli.command import read_settings


def run_export(options) -> None:
    """Compile and pack the models."""
    from lumbar.interface.device import export_fmu

    settings = read_settings(options)
    made = export_fmu(
        options.models,
        options.output,
        options.model,
        trained_on=options.trained_on,
        rate_Hz=options.rate,
        targets=options.target,
        effect_files=settings.improvement.effect_files,
        settings=settings.runtime,
    )
    for file in made:
        print(file)


def run_render(options) -> None:
    """Print what each model does; write table and figures where a folder is given."""
    from lumbar.interface.device import render

    settings = read_settings(options)
    found = render(
        options.models,
        options.model,
        trained_on=options.trained_on,
        mass_kg=options.mass,
        damping_N_s_m=options.damping,
        hand_stiffness_N_m=options.hand,
        rate_Hz=options.rate,
        effect_files=settings.improvement.effect_files,
        settings=settings.runtime,
    )
    print(found)
    if options.output:
        found.save(options.output)
