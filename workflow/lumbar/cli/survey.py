"""``lumbar survey``: ratings of the models by participants."""

from __future__ import annotations

from pathlib import Path

from lumbar.cli.settings import add_data, add_output, load_settings, new_command


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "survey",
        "analyse participants' ratings as the thesis did (Table 3.2) and within participants",
        "lumbar survey survey.csv --output out",
    )
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="participants' sheet; survey.layout names its columns"
    )
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Write tables, figures and survey.json, and print the overall tests."""
    from lumbar.files import write_json
    from lumbar.records.ratings import read_ratings
    from lumbar.reports.figures.style import save
    from lumbar.reports.figures.survey_figures import best_picks_figure, likert_figure
    from lumbar.survey.survey_analysis import analyse_survey

    settings = load_settings(options.config)
    survey, output = settings.survey, options.output
    ratings = read_ratings(options.file, survey.layout)
    data = options.data or options.file.name
    analysis = analyse_survey(ratings, survey, settings.seed, data)
    label = analysis.results["data"]
    likert = likert_figure(ratings.models, ratings.counts(), survey.scale_labels, survey.statement)
    for name, table in analysis.tables.items():
        table.write(output / name)
    write_json(output / "survey.json", analysis.results)
    save(likert, output / "survey_likert", label)
    save(
        best_picks_figure(analysis.results["best_picks"], survey.confidence),
        output / "survey_best_picks_figure",
        label,
    )
    print(f"{len(ratings)} participants rated {', '.join(ratings.models)} ({label})")
    for name in ("kruskal_wallis", "friedman"):
        result = analysis.results[name]
        freedom = f"{result['dof']} degrees of freedom"
        print(f"{name}: {result['statistic']:.2f}, {freedom}, p = {result['p_value']:#.2g}")
    print(f"tables and figures are in {output}")
