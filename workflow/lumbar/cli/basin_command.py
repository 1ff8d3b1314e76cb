"""``lumbar basin``: basins of attraction of one lift."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "basin",
        "basins of attraction of one lift, with their checks",
        "lumbar basin out/pendulum.csv --output out",
    )
    parser.add_argument("states", type=Path, metavar="PENDULUM.csv", help="from 'lumbar lift'")
    parser.add_argument(
        "--facts", type=Path, metavar="PENDULUM.json", help="default: the JSON file beside PENDULUM.csv"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Compute and check the basins, write areas and funnels, and end with an error if a basin is missing."""
    from lumbar.base.errors import NumericalError
    from lumbar.base.files import read_json
    from lumbar.interface.lift_basins import basins
    from lumbar.lifting.stability.model.failures import announcement

    settings = load_settings(*options.config)
    facts = read_json(options.facts) if options.facts else None
    found = basins(options.states, facts=facts, settings=settings.stability, seed=settings.seed)
    found.save(options.output)
    print(f"{len(found.areas)} basins are in {options.output / 'boa.csv'}")
    if len(found.failures()):
        raise NumericalError(announcement(options.output / "failures.csv"))
