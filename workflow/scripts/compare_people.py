"""Measures of all people in one table, and the differences between groups and boxes."""

from job import run, stem


def main(
    input,
    output,
    labels: dict[str, str],
    groups: tuple[str, str],
    source_label: str,
):
    """Join the subjects' tables, compare groups and boxes, write tables and figure."""
    import pandas as pd

    from lumbar.base.files import write_csv
    from lumbar.interface.people import compare_groups
    from lumbar.publishing.figures.style import save

    table = pd.concat([pd.read_csv(path) for path in input.persons], ignore_index=True)
    table.insert(2, "group", table["person"].map(labels))
    write_csv(output.measures, table)
    compared = compare_groups(table, groups=groups, source_label=source_label)
    compared.table.write(stem(output.measure_comparison))
    save(compared.figure(), stem(output.measure_comparison_figure), source_label)


run(main, snakemake)
