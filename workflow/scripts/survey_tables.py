"""Tables of the survey: Table 3.2, the within-subject analysis, the best picks, and all results as JSON."""

from job import run, stem

from lumbar.settings.survey import SurveySettings


def main(input, output, settings: SurveySettings, seed: int, data: str):
    """Read the answers, analyse them as published and within participants, write tables and results."""
    from lumbar.base.files import write_json
    from lumbar.records.ratings import read_ratings
    from lumbar.tissue.survey.survey_analysis import analyse_survey

    ratings = read_ratings(input.ratings, settings.layout)
    analysis = analyse_survey(ratings, settings, seed, data)
    for name, table in analysis.tables.items():
        table.write(stem(output[name]))
    write_json(output.results, analysis.results)


run(main, snakemake)
