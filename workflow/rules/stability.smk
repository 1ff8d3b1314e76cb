# From the pendulums of the deposit to basins of attraction: one job per lift, one for tables and figures.

# Settings of the chapter that make the basins of a lift, and those that its measures need.
BASINS = {"pendulum", "regulator", "goal_level", "knots", "checks", "proof", "thesis_method", "attack"}
MEASURED = {"pendulum", "regulator", "goal_level", "fewer_knots", "measures"}
TABULATED = {
    "pendulum",
    "regulator",
    "goal_level",
    "fewer_knots",
    "checks",
    "thesis_method",
    "lyapunov_shares",
}
TABULATED |= {"compare", "sensitivity_factor"}


rule basins_of_lift:
    input:
        states="<results>/lifting/{lift}/pendulum.csv",
        facts="<results>/lifting/{lift}/pendulum.json",
        thesis="<results>/lifting/{lift}/thesis_pendulum.csv",
    output:
        boa="<results>/stability/{lift}/boa.csv",
        funnel="<results>/stability/{lift}/funnel.csv",
        failures="<results>/stability/{lift}/failures.csv",
    log:
        "<logs>/basins_of_lift/{lift}.log",
    benchmark:
        "<benchmarks>/basins_of_lift/{lift}.tsv"
    group:
        "lift"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=220, seconds=17),
    params:
        code=library_code("basins_of_lift.py"),
        settings=plain(settings.stability, BASINS),
        seed=settings.seed,
    message:
        "{wildcards.lift}: basins of attraction"
    script:
        "../scripts/basins_of_lift.py"


if study.has("stability"):

    rule stability_tables:
        input:
            boa=[f"<results>/stability/{lift}/boa.csv" for lift in study.lifts],
            failures=[f"<results>/stability/{lift}/failures.csv" for lift in study.lifts],
            funnels=[f"<results>/stability/{lift}/funnel.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            thesis=[f"<results>/lifting/{lift}/thesis_pendulum.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            published=source("resources/thesis/table_4_1.csv"),
        output:
            **published(
                *("table_4_1", "table_4_1_controls", "table_4_1_parts", "table_4_1_alternations"),
                *("basin_areas", "missing_basins", "figure_4_3", "figure_4_4", "basin_comparison"),
            ),
            boa="<results>/stability/boa.csv",
            failures="<results>/stability/failures.csv",
        log:
            "<logs>/stability_tables.log",
        benchmark:
            "<benchmarks>/stability_tables.tsv"
        group:
            "lift_pages"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=220 + 0.2 * len(study.lifts), seconds=15 + len(study.lifts)),
        params:
            code=library_code("stability_tables.py"),
            settings=plain(settings.stability, TABULATED),
            labels=study.labels,
            source_label=DATA,
        message:
            "Table 4.1, its controls and parts, the areas of all basins, Figures 4.3 and 4.4"
        script:
            "../scripts/stability_tables.py"

    rule measure_movement:
        input:
            body=[f"<results>/lifting/{lift}/body.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            events=[f"<results>/lifting/{lift}/events.json" for lift in study.lifts],
        output:
            **published("movement_measures", "movement_course", "base_of_support"),
            courses=[f"<results>/measures/{lift}.csv" for lift in study.lifts],
        log:
            "<logs>/measure_movement.log",
        benchmark:
            "<benchmarks>/measure_movement.tsv"
        group:
            "lift_pages"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=160 + 0.2 * len(study.lifts), seconds=6 + len(study.lifts)),
        params:
            code=library_code("measure_movement.py"),
            settings=plain(settings.stability, {"pendulum", "measures"}),
            labels=study.labels,
            source_label=DATA,
        message:
            "Margins of stability, impulse to a step, posture and moment about L5/S1 of every lift"
        script:
            "../scripts/measure_movement.py"

    rule show_lifts:
        input:
            body=[f"<results>/lifting/{lift}/body.csv" for lift in study.lifts],
            centres=[f"<results>/lifting/{lift}/com.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            facts=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            events=[f"<results>/lifting/{lift}/events.json" for lift in study.lifts],
        output:
            **published("lift_pages"),
        log:
            "<logs>/show_lifts.log",
        benchmark:
            "<benchmarks>/show_lifts.tsv"
        group:
            "lift_pages"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=222, seconds=15),
        params:
            code=library_code("show_lifts.py"),
            settings=plain(settings.stability, {*MEASURED, "limits", "knots"}),
            source_label=DATA,
        message:
            "An interactive page of every lift, with pushes against the funnel"
        script:
            "../scripts/show_lifts.py"
