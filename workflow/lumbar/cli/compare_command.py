"""``lumbar compare``: compare a model of tissue tests with every record."""

from __future__ import annotations

from lumbar.cli.options import add_model, new_command
from lumbar.cli.record_folder import refined


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "compare",
        "compare a model of tissue tests with every record: errors with intervals and the part that could be explained",
        "lumbar compare recordings/tissue --output out",
    )
    add_model(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Fit the model, compare it with every record, write table, pictures and page, and tell it."""
    comparisons = refined(options).compare()
    comparisons.save(options.output)
    print(comparisons)
