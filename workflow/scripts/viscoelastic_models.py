"""Table 2.1, Figure 2.4 and Figure 3.2: the models, drawn and tabulated from their definitions."""

from job import run


def main(input, output, params):
    """Write the table and both drawings."""
    from lumbar.figures.analogues import analogues_figure, arx_figure
    from lumbar.figures.style import save
    from lumbar.tissue.models import HO, IL, KB, MW
    from lumbar.tissue.published import table_2_1

    table_2_1(params.data).write(output.csv.removesuffix(".csv"))
    save(arx_figure(), output.arx_svg.removesuffix(".svg"), "")
    save(analogues_figure((MW, KB, HO, IL)), output.analogues_svg.removesuffix(".svg"), "")


run(main, snakemake)
