# System identification: tissue models from tissue tests, by ridge ARX as in the thesis and by output error beside it.
# Reads the recordings of chapter tissue; makes Tables 2.1 and 3.1, Figures 2.4, 3.2, 3.4 and 3.5 and models.json.

import re

TISSUE_RECORDINGS = [recording(record.file) for record in settings.tissue.records]
TRAINING = settings.tissue.training


rule viscoelastic_models:
    input:
        checked=ALL_CHECKED,
        sources=library_sources("viscoelastic_models.py"),
    output:
        csv="<results>/tables/table_2_1.csv",
        tex="<results>/tables/table_2_1.tex",
        html=report(
            "<results>/tables/table_2_1.html",
            caption=caption("table_2_1"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Table 2.1"},
        ),
        arx_svg=report(
            "<results>/figures/figure_2_4.svg",
            caption=caption("figure_2_4"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Figure 2.4"},
        ),
        arx_pdf="<results>/figures/figure_2_4.pdf",
        analogues_svg=report(
            "<results>/figures/figure_3_2.svg",
            caption=caption("figure_3_2"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Figure 3.2"},
        ),
        analogues_pdf="<results>/figures/figure_3_2.pdf",
    log:
        "<logs>/viscoelastic_models.log",
    benchmark:
        "<benchmarks>/viscoelastic_models.tsv"
    conda:
        CONDA
    params:
        data="definitions, no data",
    message:
        "Table 2.1, Figures 2.4 and 3.2: the models and their mechanical analogues"
    script:
        "../scripts/viscoelastic_models.py"


rule identify_tissue:
    input:
        recordings=TISSUE_RECORDINGS,
        effects=list(settings.improvement.effect_files),
        checked="<results>/checked/tissue.json",
        sources=library_sources("identify_tissue.py"),
    output:
        fits="<results>/tissue/identified/{training}.json",
        grid="<results>/tissue/identified/{training}.csv",
    log:
        "<logs>/identify_tissue/{training}.log",
    benchmark:
        "<benchmarks>/identify_tissue/{training}.tsv"
    wildcard_constraints:
        training="|".join(map(re.escape, TRAINING)) or "none",
    conda:
        CONDA
    params:
        tissue=plain(settings.tissue),
        training=lambda wildcards: wildcards.training,
        improvement=without(settings.improvement, "train", "record_sets"),
        seed=settings.seed,
        data=DATA,
    message:
        "Identification of the tissue models on {wildcards.training}"
    script:
        "../scripts/identify_tissue.py"


rule tissue_models:
    input:
        fits=expand("<results>/tissue/identified/{training}.json", training=TRAINING),
        grids=expand("<results>/tissue/identified/{training}.csv", training=TRAINING),
        recordings=TISSUE_RECORDINGS,
        effects=list(settings.improvement.effect_files),
        checked="<results>/checked/tissue.json",
        sources=library_sources("tissue_models.py"),
    output:
        models="<results>/tissue/models.json",
        search="<results>/tissue/search.csv",
        csv="<results>/tables/table_3_1.csv",
        tex="<results>/tables/table_3_1.tex",
        html=report(
            "<results>/tables/table_3_1.html",
            caption=caption("table_3_1"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Table 3.1"},
        ),
        parameters_csv="<results>/tables/physical_parameters.csv",
        parameters_tex="<results>/tables/physical_parameters.tex",
        parameters_html=report(
            "<results>/tables/physical_parameters.html",
            caption=caption("physical_parameters"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Physical parameters"},
        ),
        excitation_svg=report(
            "<results>/figures/figure_3_4.svg",
            caption=caption("figure_3_4"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Figure 3.4"},
        ),
        excitation_pdf="<results>/figures/figure_3_4.pdf",
        comparison_svg=report(
            "<results>/figures/figure_3_5.svg",
            caption=caption("figure_3_5"),
            category=CATEGORIES["tissue"],
            labels={"artefact": "Figure 3.5"},
        ),
        comparison_pdf="<results>/figures/figure_3_5.pdf",
    log:
        "<logs>/tissue_models.log",
    benchmark:
        "<benchmarks>/tissue_models.tsv"
    conda:
        CONDA
    params:
        tissue=plain(settings.tissue),
        effects=plain(settings.improvement.effects),
        data=DATA,
    message:
        "Table 3.1, Figures 3.4 and 3.5: the identified tissue models"
    script:
        "../scripts/tissue_models.py"
