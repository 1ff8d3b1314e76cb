"""``lumbar doctor``: what could have been seen in a folder of records, and what further record would help."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_data, add_fit, add_folder, add_output, new_command
from lumbar.cli.record_folder import read_folder


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "doctor",
        "say which effects and mistakes could have been seen in records, from what size on, and what to record besides",
        "lumbar doctor recordings/tissue",
    )
    add_folder(parser)
    add_fit(parser)
    parser.add_argument(
        "--effects",
        metavar="A,B",
        type=lambda text: [name.strip() for name in text.split(",")],
        help="effects that are put into the records (default: all of the catalogue)",
    )
    parser.add_argument("--no-faults", action="store_true", help="leave out the mistakes of a recording")
    parser.add_argument(
        "--excitation",
        type=Path,
        metavar="FILE",
        help="CSV file for the further record that helps most, to play on the machine",
    )
    add_output(parser, required=False)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Put effects and mistakes into the records, diagnose them, print what was told, and write it where asked."""
    from lumbar.interface.doctor import doctor

    records, settings, data = read_folder(options)
    found = doctor(
        records,
        effects=options.effects,
        faults=not options.no_faults,
        settings=settings,
        data=data,
    )
    print(found)
    if options.output:
        found.save(options.output)
    if options.excitation:
        found.save_excitation(options.excitation)
