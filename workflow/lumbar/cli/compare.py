"""``lumbar compare``: compare a model of tissue tests with every record."""

from __future__ import annotations

from lumbar.cli.settings import add_data, add_output, new_command
from lumbar.cli.tissue_folder import add_model, fitted_model


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
    """Fit the model, simulate it on every record, write the table and tell it."""
    from lumbar.improvement.compare import comparison_table
    from lumbar.improvement.simulated import compare_and_locate

    settings, records, chosen, experiment, ladder = fitted_model(options)
    comparisons, _ = compare_and_locate(
        records, ladder[-1].fit, experiment.floor, experiment.training.name, settings["seed"], chosen.centre
    )
    data = options.data or options.folder.name
    comparison_table(comparisons, data).write(options.output / "compare")
    for item in comparisons:
        print(
            f"{item.record}: {item.vaf.value:.1f} %VAF, RMS error {item.rms.value:.3g} {experiment.output_unit}"
        )
