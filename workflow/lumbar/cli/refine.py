"""``lumbar refine``: add named effects to a model of tissue tests."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, load_settings, new_command
from lumbar.cli.tissue_folder import add_selection, read_folder, selection


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "refine",
        "add physical effects to a model of tissue tests and refit it",
        "lumbar refine recordings/tissue --add coulomb_friction --output out",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="one file per excitation")
    parser.add_argument(
        "--add",
        action="append",
        required=True,
        metavar="EFFECT",
        help="effect to add; may be given several times",
    )
    add_selection(parser)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Refit base and effects jointly, write refined.json, print the error ladder."""
    from lumbar.files import write_json
    from lumbar.improvement.refined_model import refined_document
    from lumbar.improvement.refinement import refine
    from lumbar.improvement.sentences import effects_text

    settings = load_settings(options.config, "tissue", "improvement")
    records = read_folder(options.folder, settings["tissue"])
    chosen = selection(options, settings["improvement"])
    experiment, ladder = refine(records, options.add, chosen)
    data = options.data or options.folder.name
    write_json(options.output / "refined.json", refined_document(ladder, experiment, data))
    for item in ladder:
        name = effects_text(item.effects) if item.effects else chosen.base
        print(
            f"{name}: {item.train_rms:.4g} {experiment.output_unit} in training, {item.test_rms:.4g} unseen"
        )
