"""Table 2.1, Figure 2.4 and Figure 3.2: the models, drawn and tabulated from their definitions."""

from job import run


def main(input, output, params):
    """Write the table and both drawings."""
    from lumbar.identification.table_2_1 import table_2_1
    from lumbar.models.tissue_models import HO, IL, KB, MW
    from lumbar.reports.figures.analogue_figures import analogues_figure, arx_figure
    from lumbar.reports.figures.style import save

    table_2_1(params.data).write(output.csv.removesuffix(".csv"))
    save(arx_figure(), output.arx_svg.removesuffix(".svg"), "")
    save(analogues_figure((MW, KB, HO, IL)), output.analogues_svg.removesuffix(".svg"), "")


run(main, snakemake)
