"""Tables of the survey: Table 3.2, the within-subject analysis, the best picks, and all results as JSON."""

from job import run, stem


def main(input, output, params):
    """Read the answers, analyse them as published and within participants, write tables and results."""
    from lumbar.base.files import write_json
    from lumbar.records.ratings import read_ratings
    from lumbar.settings.plain import typed
    from lumbar.settings.survey import SurveySettings
    from lumbar.tissue.survey.survey_analysis import analyse_survey

    settings = typed(SurveySettings, params.settings)
    ratings = read_ratings(input.ratings, settings.layout)
    analysis = analyse_survey(ratings, settings, params.seed, params.data)
    for name, table in analysis.tables.items():
        table.write(stem(output[name]))
    write_json(output.results, analysis.results)


run(main, snakemake)
