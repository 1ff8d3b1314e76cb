"""``lumbar refine``: add named effects to a model of tissue tests."""

from __future__ import annotations

from lumbar.cli.options import add_model, new_command
from lumbar.cli.record_folder import refined


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "refine",
        "add physical effects to a model of tissue tests and refit it",
        "lumbar refine recordings/tissue --add coulomb_friction --output out",
    )
    add_model(parser, effects_required=True)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Refit base and effects jointly, write refined.json, print the error ladder."""
    refinement = refined(options)
    refinement.save(options.output)
    print(refinement)
