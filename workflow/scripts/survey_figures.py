"""Figures of the survey: diverging bars of the ratings, and the best picks with their intervals."""

from job import run, stem


def main(input, output, scale_labels: list[str], statement: str, confidence: float):
    """Draw the results of the survey."""
    import numpy as np

    from lumbar.base.files import read_json
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.survey_figures import best_picks_figure, likert_figure

    results = read_json(input.results)
    counts = np.array([results["rating_counts"][model] for model in results["models"]])
    likert = likert_figure(results["models"], counts, scale_labels, statement)
    picks = best_picks_figure(results["best_picks"], confidence)
    save(likert, stem(output.survey_likert), results["data"])
    save(picks, stem(output.survey_best_picks_figure), results["data"])


run(main, snakemake)
