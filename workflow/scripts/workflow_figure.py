"""The workflow drawn from the graph of its rules."""

from job import run, stem


def main(input, output, edges: list, chapters: dict[str, str], chapter_of: dict[str, str]):
    """Draw the graph."""
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.workflow_figure import draw_workflow

    figure = draw_workflow(edges, chapter_of, chapters)
    save(figure, stem(output.workflow), data="")


run(main, snakemake)
