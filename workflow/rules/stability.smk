# From the pendulums of the deposit to basins of attraction: one job per lift, one for the tables, one for the figures.


rule basins_of_lift:
    input:
        states="<results>/lifting/{lift}/pendulum.csv",
        facts="<results>/lifting/{lift}/pendulum.json",
        sources=library_sources("basins_of_lift.py"),
    output:
        boa="<results>/stability/{lift}/boa.csv",
        funnel="<results>/stability/{lift}/funnel.csv",
        extended="<results>/stability/{lift}/extended.csv",
        failures="<results>/stability/{lift}/failures.csv",
    log:
        "<logs>/basins_of_lift/{lift}.log",
    benchmark:
        "<benchmarks>/basins_of_lift/{lift}.tsv"
    conda:
        CONDA
    params:
        settings=plain(settings.stability),
        seed=settings.seed,
    message:
        "{wildcards.lift}: basins of attraction"
    script:
        "../scripts/basins_of_lift.py"


if study.has("stability"):

    rule stability_tables:
        input:
            boa=[f"<results>/stability/{lift}/boa.csv" for lift in study.lifts],
            extended=[f"<results>/stability/{lift}/extended.csv" for lift in study.lifts],
            failures=[f"<results>/stability/{lift}/failures.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            sources=library_sources("stability_tables.py"),
        output:
            boa="<results>/stability/boa.csv",
            failures="<results>/stability/failures.csv",
            table_4_1=multiext("<results>/tables/table_4_1", ".csv", ".tex"),
            table_4_1_html=report(
                "<results>/tables/table_4_1.html",
                caption=caption("table_4_1"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Table 4.1"},
            ),
            basin_areas=multiext("<results>/tables/basin_areas", ".csv", ".tex"),
            basin_areas_html=report(
                "<results>/tables/basin_areas.html",
                caption=caption("basin_areas"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Areas of all basins"},
            ),
            extended_basins=multiext("<results>/tables/extended_basins", ".csv", ".tex"),
            extended_basins_html=report(
                "<results>/tables/extended_basins.html",
                caption=caption("extended_basins"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Limits, uncertain mass, better V"},
            ),
            missing_basins=multiext("<results>/tables/missing_basins", ".csv", ".tex"),
            missing_basins_html=report(
                "<results>/tables/missing_basins.html",
                caption=caption("missing_basins"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Basins that could not be computed"},
            ),
        log:
            "<logs>/stability_tables.log",
        benchmark:
            "<benchmarks>/stability_tables.tsv"
        conda:
            CONDA
        params:
            settings=plain(settings.stability),
            seed=settings.seed,
            data=DATA,
        message:
            "Table 4.1 and the areas of all basins"
        script:
            "../scripts/stability_tables.py"

    rule stability_figures:
        input:
            funnels=[f"<results>/stability/{lift}/funnel.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            sources=library_sources("stability_figures.py"),
        output:
            figure_4_3_svg=report(
                "<results>/figures/figure_4_3.svg",
                caption=caption("figure_4_3"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Figure 4.3"},
            ),
            figure_4_3_pdf="<results>/figures/figure_4_3.pdf",
            figure_4_4_svg=report(
                "<results>/figures/figure_4_4.svg",
                caption=caption("figure_4_4"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Figure 4.4"},
            ),
            figure_4_4_pdf="<results>/figures/figure_4_4.pdf",
            basin_comparison_svg=report(
                "<results>/figures/basin_comparison.svg",
                caption=caption("basin_comparison"),
                category=CATEGORIES["stability"],
                labels={"artefact": "Basins by engine"},
            ),
            basin_comparison_pdf="<results>/figures/basin_comparison.pdf",
        log:
            "<logs>/stability_figures.log",
        benchmark:
            "<benchmarks>/stability_figures.tsv"
        conda:
            CONDA
        params:
            settings=plain(settings.stability),
            data=DATA,
        message:
            "Figures 4.3 and 4.4: basins of attraction"
        script:
            "../scripts/stability_figures.py"
