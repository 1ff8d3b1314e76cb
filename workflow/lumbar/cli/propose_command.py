"""``lumbar propose``: a short formula for what no effect of the catalogue explains."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_data, add_fit, add_folder, new_command
from lumbar.cli.record_folder import read_folder


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "propose",
        "propose a law for what no effect of the catalogue explains, or say that no short formula was found",
        "lumbar propose recordings/tissue --output my_law.yaml",
    )
    add_folder(parser)
    add_fit(parser)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="YAML",
        help="file of the effect, named after it; without it the law is only printed",
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="STEM",
        help="draw what is missing as STEM.svg and STEM.pdf",
    )
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Diagnose, look for a law, print it, and write the effect's file and picture where there is something to write."""
    from lumbar.interface.diagnosis import propose

    records, settings, data = read_folder(options)
    law = propose(records, settings=settings, data=data)
    if options.output and law.found:
        law.save(options.output, options.output.stem)
    if options.picture and law.proposal.is_needed:
        law.draw(options.picture)
    print(law)
