"""Figures 1.1 and 3.1: the workflow drawn from the graph Snakemake itself gives."""

import subprocess
import sys

from job import run, stem


def main(input, output, params):
    """Ask Snakemake for the rule graph of this very configuration and draw it."""
    from lumbar.errors import LumbarError
    from lumbar.reports.figures.style import save
    from lumbar.reports.figures.workflow_figure import draw_workflow, parse_rule_graph

    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--snakefile",
        input.snakefile,
        "--configfile",
        input.config,
    ]
    command += ["--rulegraph", "dot", "--forceall", "--nolock", "all"]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    if answer.returncode:
        raise LumbarError(f"Snakemake could not draw its rule graph:\n{answer.stderr}")
    figure = draw_workflow(parse_rule_graph(answer.stdout), params.chapter_of, params.chapters)
    save(figure, stem(output.workflow), data="")


run(main, snakemake)
