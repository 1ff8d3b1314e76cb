"""``lumbar diagnose``: which physical effect a model of tissue tests is missing."""

from __future__ import annotations

from lumbar.cli.options import add_data, add_fit, add_folder, add_output, new_command
from lumbar.cli.record_folder import read_folder


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "diagnose",
        "say which physical effect a model of tissue tests is missing, or that nothing is",
        "lumbar diagnose recordings/tissue --output out",
    )
    add_folder(parser)
    add_fit(parser)
    parser.add_argument(
        "--pictures",
        action="store_true",
        help="draw comparison, location, ladder and signatures too, show the thesis's models; takes a few seconds more",
    )
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Diagnose, write the verdict with its evidence, a page and the error ladder, print the verdict."""
    from lumbar.interface.diagnosis import diagnose

    records, settings, data = read_folder(options)
    diagnosis = diagnose(records, settings=settings, data=data)
    diagnosis.save(options.output, options.pictures)
    print(diagnosis)
