"""``lumbar export``: FMUs of identified models."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "export",
        "export identified models as FMUs for FMI 2.0 and 3.0",
        "lumbar export out/models.json --output fmu --model KB --trained-on multisine",
    )
    parser.add_argument(
        "models",
        type=Path,
        metavar="MODELS.json",
        help="models.json from 'lumbar identify', or refined.json from 'lumbar refine': its last model",
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="model to export, may be repeated (default: runtime.models)",
    )
    parser.add_argument(
        "--trained-on",
        metavar="RECORD",
        help="record the models were identified on (default: the file's only one)",
    )
    parser.add_argument(
        "--target",
        action="append",
        metavar="PLATFORM",
        help="platform to build for, may be repeated: host, x86_64-windows … (default: runtime.targets)",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="rate of the haptic loop (default: runtime.rate_Hz)",
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Compile and pack the models."""
    from lumbar.interface.device import export_fmu

    settings = load_settings(*options.config)
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
    for path in made:
        print(path)
