"""``lumbar diagnose``: which physical effect a model of tissue tests is missing."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_selection, read_and_choose


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "diagnose",
        "say which physical effect a model of tissue tests is missing, or that nothing is",
        "lumbar diagnose recordings/tissue --output out",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="one file per excitation (time_s,position_mm,force_N unless the layout says otherwise)",
    )
    add_selection(parser)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Diagnose, write diagnosis.json, diagnosis.html and ladder.csv, print the verdict."""
    from lumbar.improvement.diagnosis import diagnose
    from lumbar.improvement.report import write_diagnosis
    from lumbar.improvement.sentences import details, headline

    _, records, chosen = read_and_choose(options)
    diagnosis = diagnose(records, chosen)
    write_diagnosis(diagnosis, chosen.candidates, options.output, options.data or options.folder.name)
    print(headline(diagnosis))
    for line in details(diagnosis, chosen.candidates):
        print(f"  {line}")
