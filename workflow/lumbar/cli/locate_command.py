"""``lumbar locate``: see where a model of tissue tests fails."""

from __future__ import annotations

from lumbar.cli.options import add_model, new_command
from lumbar.cli.record_folder import refined


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "locate",
        "see where a model of tissue tests fails: time, frequency, motion, depth, reversals, correlations",
        "lumbar locate recordings/tissue --output out",
    )
    add_model(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Fit the model, see where it fails on every record, write table, pictures and page, and tell it."""
    locations = refined(options).locate()
    locations.save(options.output)
    print(locations)
