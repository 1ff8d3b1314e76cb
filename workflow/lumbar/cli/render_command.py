"""``lumbar render``: models on a haptic device in a person's hand."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "render",
        "say whether models are passive, stable or oscillating on a haptic device in a person's hand",
        "lumbar render out/models.json --model KB --mass 0.25 --damping 5.5 --hand 300 --rate 1000 --output out",
    )
    parser.add_argument(
        "models",
        type=Path,
        metavar="MODELS",
        help="models.json from 'lumbar identify', refined.json from 'lumbar refine', or an FMU for FMI 3.0",
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="model to judge, may be repeated (default: runtime.models)",
    )
    parser.add_argument(
        "--trained-on",
        metavar="RECORD",
        help="record the models were identified on (default: the file's only one)",
    )
    for option, unit, meaning in (
        ("mass", "KG", "mass of the stylus"),
        ("damping", "N_S_M", "damping of the device in N·s/m"),
        ("hand", "N_M", "stiffness of the hand in N/m"),
        ("rate", "HZ", "rate of the servo loop"),
    ):
        parser.add_argument(
            f"--{option}", type=float, metavar=unit, help=f"{meaning} (default: runtime.device)"
        )
    add_output(parser, required=False)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Print what each model does; write table and figures where a folder is given."""
    from lumbar.interface.rendering import render

    settings = load_settings(*options.config)
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
