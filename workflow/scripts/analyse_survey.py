"""The survey: Table 3.2, the within-subject analysis, the best picks and their figures."""

from job import run, stem

from lumbar.settings.runtime import SurveySettings


def main(input, output, settings: SurveySettings, seed: int, source_label: str):
    """Read the answers, analyse them as published and within participants, write tables, results and figures."""
    from lumbar.interface.people import analyse_survey

    result = analyse_survey(input.ratings, settings=settings, seed=seed, source_label=source_label)
    published = {name: stem(files) for name, files in output.items() if name != "results"}
    result.write(published | {"survey.json": output.results})


run(main, snakemake)
