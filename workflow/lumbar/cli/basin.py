"""``lumbar basin``: basins of attraction of one lift."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_output, load_settings, new_command


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "basin",
        "basins of attraction of one lift's pendulums",
        "lumbar basin out/pendulum.csv --output out",
    )
    parser.add_argument("states", type=Path, metavar="PENDULUM.csv", help="from 'lumbar lift'")
    parser.add_argument(
        "--facts", type=Path, metavar="JSON", help="masses and lengths (default: PENDULUM.json)"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Compute and check the basins, write areas and funnels, and end with an error if a basin is missing."""
    import pandas as pd

    from lumbar.errors import InputError, NumericalError
    from lumbar.files import read_json, write_csv
    from lumbar.stability.basins import basins_of_lift
    from lumbar.stability.model.failures import announcement, failures_frame
    from lumbar.stability.model.lift_trajectories import trajectories_of_lift

    settings = load_settings(options.config)
    stability = settings.stability
    facts = read_json(options.facts or options.states.with_suffix(".json"))
    try:
        states = pd.read_csv(options.states)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{options.states}: not a table of pendulum states ({error})") from error
    trajectories, failures = trajectories_of_lift(states, facts, stability.pendulum.mass)
    basins = basins_of_lift(trajectories, stability, settings.seed)
    write_csv(options.output / "boa.csv", basins.summary)
    write_csv(options.output / "funnel.csv", basins.funnels)
    failures = failures_frame([*failures, *basins.failures])
    write_csv(options.output / "failures.csv", failures)
    print(f"{len(basins.summary)} basins are in {options.output / 'boa.csv'}")
    if len(failures):
        raise NumericalError(announcement(options.output / "failures.csv"))
