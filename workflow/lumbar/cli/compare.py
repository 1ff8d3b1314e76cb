"""``lumbar compare``: compare a model of tissue tests with every record."""

from __future__ import annotations

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_model, simulated_model


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "compare",
        "compare a model of tissue tests with every record: errors with intervals and the part that could be explained",
        "lumbar compare recordings/tissue --output out",
    )
    add_model(parser)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Fit the model, simulate it on every record, write table, pictures and page, and tell it."""
    from lumbar.diagnosis.residuals.compare import comparison_table
    from lumbar.files import write_text
    from lumbar.reports.figures.comparison_figure import comparison_figure
    from lumbar.reports.figures.style import save
    from lumbar.reports.pages.record_pages import comparison_page

    model, simulated, data = simulated_model(options)
    comparisons = [item.comparison for item in simulated]
    table = comparison_table(comparisons, data)
    pictures = {}
    for item in simulated:
        stem = options.output / f"comparison_{item.record.name}"
        save(comparison_figure(item.record, item.values, comparisons, model), stem, data)
        pictures[item.record.name] = stem.with_name(f"{stem.name}.svg")
    table.write(options.output / "compare")
    write_text(options.output / "compare_page.html", comparison_page(simulated, model, data, pictures))
    for item in comparisons:
        print(item.sentence)
