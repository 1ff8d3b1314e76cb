"""``lumbar locate``: see where a model of tissue tests fails."""

from __future__ import annotations

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_model, fitted_model


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "locate",
        "see where a model of tissue tests fails: time, frequency, motion, depth, reversals, correlations",
        "lumbar locate recordings/tissue --output out",
    )
    add_model(parser)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Fit the model, simulate it on every record, write the table and tell it."""
    from lumbar.improvement.locate import location_table
    from lumbar.improvement.simulated import compare_and_locate

    settings, records, chosen, experiment, ladder = fitted_model(options)
    _, locations = compare_and_locate(
        records, ladder[-1].fit, experiment.floor, experiment.training.name, settings["seed"], chosen.centre
    )
    data = options.data or options.folder.name
    location_table(locations, data).write(options.output / "location")
    for item in locations:
        print("\n  ".join(item.sentences))
