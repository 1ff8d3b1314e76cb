"""``lumbar survey``: ratings of the models by participants."""

from __future__ import annotations

from lumbar.cli.options import DATA, OUTPUT, Command, given_settings, path


def run_survey(options) -> None:
    """Write tables, figures and survey.json, and print the overall tests."""
    from lumbar.interface.participants import analyse_survey

    settings = given_settings(options)
    data = options.data or options.file.name
    found = analyse_survey(options.file, settings=settings.survey, seed=settings.seed, data=data)
    found.save(options.output)
    print(found)
    print(f"tables and figures are in {options.output}")


SURVEY = Command(
    "survey",
    "analyse participants' ratings as the thesis did (Table 3.2) and within participants",
    "lumbar survey survey.csv --output out",
    run_survey,
    (path("file", metavar="FILE", help="participants' sheet; survey.layout names its columns"), OUTPUT, DATA),
)
