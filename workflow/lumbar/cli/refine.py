"""``lumbar refine``: add named effects to a model of tissue tests."""

from __future__ import annotations

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_model, fitted_model


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "refine",
        "add physical effects to a model of tissue tests and refit it",
        "lumbar refine recordings/tissue --add coulomb_friction --output out",
    )
    add_model(parser, effects_required=True)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Refit base and effects jointly, write refined.json, print the error ladder."""
    from lumbar.diagnosis.selection.refined_model import refined_document
    from lumbar.diagnosis.selection.sentences import effects_text
    from lumbar.files import write_json

    _, _, chosen, experiment, ladder = fitted_model(options)
    data = options.data or options.folder.name
    write_json(options.output / "refined.json", refined_document(ladder, experiment, data))
    for item in ladder:
        name = effects_text(item.effects) if item.effects else chosen.base
        print(
            f"{name}: {item.train_rms:.4g} {experiment.output_unit} in training, {item.test_rms:.4g} unseen"
        )
