"""Figures 1.1 and 3.1: how the thesis and its article hang together."""

from job import run, stem


def main(input, output):
    """Draw both."""
    from lumbar.publishing.figures.outline_figures import article_figure, outline_figure
    from lumbar.publishing.figures.style import save

    save(outline_figure(), stem(output.figure_1_1), data="")
    save(article_figure(), stem(output.figure_3_1), data="")


run(main, snakemake)
