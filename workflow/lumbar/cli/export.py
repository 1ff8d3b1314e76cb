"""``lumbar export``: FMUs of identified models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lumbar.cli.settings import add_output, load_settings, new_command


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
        help="rate of the haptic loop (default: runtime.rate_Hz, or that of the models)",
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Compile and pack the models."""
    from lumbar.effects.catalogue import catalogues_with
    from lumbar.files import read_json
    from lumbar.fmu.build.compiler import cache_folder
    from lumbar.fmu.build.export_model import select_models
    from lumbar.fmu.build.package import export_fmus
    from lumbar.models.models_file import read_models

    settings = load_settings(options.config)
    runtime = settings.runtime
    content = read_json(options.models)
    models = read_models(content, catalogues_with(settings.improvement.effect_files))
    trained_on = {model.trained_on for model in models} - {None}
    only = trained_on.pop() if len(trained_on) == 1 else runtime.trained_on
    # Of an error ladder, which holds no discrete model, the last rung is what a user wants.
    ladder = not any(model.discrete for model in models)
    runtime = replace(
        runtime,
        trained_on=options.trained_on or only,
        models=tuple(options.model or ([models[-1].name] if ladder else runtime.models)),
        targets=tuple(options.target or runtime.targets),
        rate_Hz=options.rate or runtime.rate_Hz,
    )
    selected = select_models(models, runtime)
    data = content.get("data") or options.models.name
    cache = cache_folder(runtime.compiler_cache)
    for path in export_fmus(selected, options.output, data, runtime.targets, cache):
        print(path)
