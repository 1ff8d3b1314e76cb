"""``lumbar locate``: see where a model of tissue tests fails."""

from __future__ import annotations

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_model, simulated_model


def add(commands) -> None:
    """Add the command to the parser."""
    parser = new_command(
        commands,
        "locate",
        "see where a model of tissue tests fails: time, frequency, motion, depth, reversals, correlations",
        "lumbar locate recordings/tissue --output out",
    )
    add_model(parser)
    add_output(parser)
    add_data(parser)
    parser.set_defaults(run=run)


def run(options) -> None:
    """Fit the model, simulate it on every record, write table, pictures and page, and tell it."""
    from lumbar.diagnosis.residuals.locate import location_table
    from lumbar.files import write_text
    from lumbar.reports.figures.location_figure import location_figure
    from lumbar.reports.figures.style import save
    from lumbar.reports.pages.record_pages import location_page

    model, simulated, data = simulated_model(options)
    table = location_table([item.location for item in simulated], data)
    pictures = {}
    for item in simulated:
        stem = options.output / f"location_{item.record.name}"
        save(location_figure(item.location), stem, data)
        pictures[item.record.name] = stem.with_name(f"{stem.name}.svg")
    table.write(options.output / "location")
    write_text(options.output / "location_page.html", location_page(simulated, model, data, pictures))
    for item in simulated:
        print("\n  ".join(item.location.sentences))
