"""``lumbar survey``: ratings of the models by participants."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.options import add_data, add_output, new_command
from lumbar.study.load_study import load_settings


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "survey",
        "analyse participants' ratings as the thesis did (Table 3.2) and within participants",
        "lumbar survey survey.csv --output out",
    )
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="participants' sheet; survey.layout names its columns"
    )
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Write tables, figures and survey.json, and print the overall tests."""
    from lumbar.interface.participants import analyse_survey

    settings = load_settings(*options.config)
    data = options.data or options.file.name
    found = analyse_survey(options.file, settings=settings.survey, seed=settings.seed, data=data)
    found.save(options.output)
    print(found)
    print(f"tables and figures are in {options.output}")
