"""The survey: Table 3.2, the within-subject analysis, the best picks and their figures."""

from job import run, stem

from lumbar.settings.survey import SurveySettings


def main(input, output, settings: SurveySettings, seed: int, source_label: str):
    """Read the answers, analyse them as published and within participants, write tables, results and figures."""
    import numpy as np

    from lumbar.base.files import write_json
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.survey_figures import best_picks_figure, likert_figure
    from lumbar.records.ratings import read_ratings
    from lumbar.tissue.survey.survey_analysis import analyse_survey

    analysis = analyse_survey(read_ratings(input.ratings, settings.layout), settings, seed, source_label)
    results = analysis.results
    for name, table in analysis.tables.items():
        table.write(stem(output[name]))
    write_json(output.results, results)
    counts = np.array([results["rating_counts"][model] for model in results["models"]])
    likert = likert_figure(results["models"], counts, settings.scale_labels, settings.statement)
    picks = best_picks_figure(results["best_picks"], settings.confidence)
    save(likert, stem(output.survey_likert), results["data"])
    save(picks, stem(output.survey_best_picks_figure), results["data"])


run(main, snakemake)
