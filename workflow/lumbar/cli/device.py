"""Commands that bring models to a haptic device: ``lumbar device``, ``render`` and ``export``."""

from __future__ import annotations

from lumbar.cli.options import OUTPUT, OUTPUT_OR_PRINTED, Command, given_settings, option, path, say_what_runs

TRAINED_ON = option(
    "--trained-on",
    metavar="RECORD",
    help="record the models were identified on (default: the file's only one)",
)


def run_export(options) -> None:
    """Compile and pack the models."""
    from lumbar.interface.device import export_fmu

    settings = given_settings(options)
    made = export_fmu(
        options.models,
        options.output,
        options.model,
        trained_on=options.trained_on,
        rate_Hz=options.rate,
        targets=options.target,
        effect_files=settings.improvement.effect_files,
        sign=options.sign,
        settings=settings.runtime,
    )
    for file in made:
        print(file)


EXPORT = Command(
    "export",
    "export identified models as FMUs for FMI 2.0 and 3.0",
    "lumbar export out/models.json --output fmu --model KB --trained-on multisine",
    run_export,
    (
        path(
            "models",
            metavar="MODELS.json",
            help="models.json from 'lumbar identify', or refined.json from 'lumbar refine': its last model",
        ),
        option(
            "--model",
            action="append",
            metavar="NAME",
            help="model to export, may be repeated (default: runtime.models)",
        ),
        TRAINED_ON,
        option(
            "--target",
            action="append",
            metavar="PLATFORM",
            help="platform to build for, may be repeated: host, x86_64-windows … (default: runtime.targets)",
        ),
        option("--rate", type=float, metavar="HZ", help="rate of the haptic loop (default: runtime.rate_Hz)"),
        path(
            "--sign",
            metavar="KEY",
            help="sign each file with this key of ssh-keygen: FILE.fmu.sig beside it, for 'lumbar check --key KEY.pub'",
        ),
        OUTPUT,
    ),
)


def run_render(options) -> None:
    """Print what each model does; write table and figures where a folder is given."""
    from lumbar.interface.device import render

    settings = given_settings(options)
    say_what_runs([options.models] if options.models.suffix == ".fmu" else [], options.trust)
    found = render(
        options.models,
        options.model,
        trained_on=options.trained_on,
        mass_kg=options.mass,
        damping_N_s_m=options.damping,
        hand_stiffness_N_m=options.hand,
        rate_Hz=options.rate,
        trust=options.trust,
        effect_files=settings.improvement.effect_files,
        settings=settings.runtime,
    )
    print(found)
    if options.output:
        found.save(options.output)


RENDER = Command(
    "render",
    "say whether models are passive, stable or oscillating on a haptic device in a person's hand",
    "lumbar render out/models.json --model KB --mass 0.25 --damping 5.5 --hand 300 --rate 1000 --output out",
    run_render,
    (
        path(
            "models",
            metavar="MODELS",
            help="models.json from 'lumbar identify', refined.json from 'lumbar refine', or an FMU for FMI 3.0",
        ),
        option(
            "--model",
            action="append",
            metavar="NAME",
            help="model to judge, may be repeated (default: runtime.models)",
        ),
        TRAINED_ON,
        *(
            option(f"--{name}", type=float, metavar=unit, help=f"{meaning} (default: runtime.device)")
            for name, unit, meaning in (
                ("mass", "KG", "mass of the stylus"),
                ("damping", "N_S_M", "damping of the device in N·s/m"),
                ("hand", "N_M", "stiffness of the hand in N/m"),
                ("rate", "HZ", "rate of the servo loop"),
            )
        ),
        OUTPUT_OR_PRINTED,
    ),
)


def run_device(options) -> None:
    """Print what the recording tells; write the configuration where a file is given."""
    from lumbar.interface.device_identification import identify_device

    found = identify_device(options.recording, settings=given_settings(options))
    print(found)
    if options.output:
        found.save(options.output)
        print(f"{options.output}: next: lumbar render MODELS --config {options.output}")


DEVICE = Command(
    "device",
    "identify mass, damping, dry friction and delay of a haptic device from its stylus in the air",
    "lumbar device recording.csv --output device.yaml\n  lumbar render out/models.json --config device.yaml",
    run_device,
    (
        path(
            "recording",
            metavar="RECORDING",
            help="file with time_s, force_N (commanded) and position_mm (read) at every tick, nobody holding the stylus",
        ),
        path("--output", metavar="YAML", help="file for --config with the device (default: print only)"),
    ),
)
