"""Tables of the survey: Table 3.2, the within-subject analysis, the best picks, and all results as JSON."""

from job import run, stem


def main(input, output, params):
    """Read the answers, analyse them as published and within participants, write tables and results."""
    from lumbar.files import write_json
    from lumbar.interface.participants import analyse_survey
    from lumbar.settings.plain import typed
    from lumbar.settings.survey import SurveySettings

    settings = typed(SurveySettings, params.settings)
    analysis = analyse_survey(input.ratings, settings=settings, seed=params.seed, data=params.data).analysis
    for name, table in analysis.tables.items():
        table.write(stem(output[name]))
    write_json(output.results, analysis.results)


run(main, snakemake)
