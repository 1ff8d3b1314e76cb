"""Table 2.1 and Figures 1.1, 2.4, 3.1 and 3.2: models and steps, drawn and tabulated from their definitions."""

from job import run, stem


def main(input, output, source_label: str):
    """Write the table and all drawings."""
    from lumbar.publishing.figures.style import save
    from lumbar.publishing.figures.tissue_figures import (
        analogue_picture,
        analogues_figure,
        article_figure,
        arx_figure,
        outline_figure,
    )
    from lumbar.tissue.identification.model_tables import table_2_1
    from lumbar.tissue.models.tissue_models import HO, IL, KB, MW, TABLE_2_1

    pictures = [analogue_picture(model) for model in TABLE_2_1]
    table_2_1(source_label, pictures).write(stem(output.table_2_1))
    save(outline_figure(), stem(output.figure_1_1), source_label="")
    save(arx_figure(), stem(output.figure_2_4), source_label="")
    save(article_figure(), stem(output.figure_3_1), source_label="")
    save(analogues_figure((MW, KB, HO, IL)), stem(output.figure_3_2), source_label="")


run(main, snakemake)
