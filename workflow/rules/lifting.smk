# From filtered markers to the pendulums of the deposit: per lift its gaps, events, centres of mass and
# pendulum states; one job for all figures.

# What of the chapter's settings makes pendulums of markers; a job that reads another key fails and names it.
LIFT = {"markers", "gaps", "filter", "events", "segments", "segment_ends", "hip_centres"}
LIFT |= {"box", "pivot", "frame", "points"}
# What of a subject: neither other trials nor the label change a lift.
LIFTER = {"name", "sex", "mass_kg", "height_m", "assumed"}


rule lift:
    input:
        markers=lambda wildcards: recording(study.lifts[wildcards.lift].trial.markers),
        static=lambda wildcards: [
            recording(path) for path in [study.lifts[wildcards.lift].static] if path is not None
        ],
        checked=ancient("<results>/checked/lifting.json"),
    output:
        centres="<results>/lifting/{lift}/com.csv",
        body="<results>/lifting/{lift}/body.csv",
        states="<results>/lifting/{lift}/pendulum.csv",
        summary="<results>/lifting/{lift}/pendulum.json",
        thesis_states="<results>/lifting/{lift}/thesis_pendulum.csv",
        events="<results>/lifting/{lift}/events.json",
        gaps="<results>/lifting/{lift}/gaps.csv",
        motion="<results>/lifting/{lift}/motion.csv",
        landmarks="<results>/lifting/{lift}/landmarks.csv",
        quality="<results>/lifting/{lift}/quality.json",
    log:
        "<logs>/lift/{lift}.log",
    benchmark:
        "<benchmarks>/lift/{lift}.tsv"
    group:
        "lift"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=155, seconds=4),
    params:
        code=library_code("analyse_lift.py"),
        lift="{lift}",
        subject=lambda wildcards: plain(study.subjects[study.lifts[wildcards.lift].subject], LIFTER),
        trial=lambda wildcards: plain(study.lifts[wildcards.lift].trial),
        settings=plain(settings.lifting, LIFT),
        source_label=DATA,
    message:
        "{wildcards.lift}: events, centres of mass, pendulum states"
    script:
        "../scripts/analyse_lift.py"


if study.has("lifting"):

    rule lifting_figures:
        input:
            centres=[f"<results>/lifting/{lift}/com.csv" for lift in study.lifts],
            states=[f"<results>/lifting/{lift}/pendulum.csv" for lift in study.lifts],
            summary=[f"<results>/lifting/{lift}/pendulum.json" for lift in study.lifts],
            events=[f"<results>/lifting/{lift}/events.json" for lift in study.lifts],
            motion=[f"<results>/lifting/{lift}/motion.csv" for lift in study.lifts],
            landmarks=[f"<results>/lifting/{lift}/landmarks.csv" for lift in study.lifts],
            body=[f"<results>/lifting/{lift}/body.csv" for lift in study.lifts],
            quality=[f"<results>/lifting/{lift}/quality.json" for lift in study.lifts],
        output:
            **published("quality", "lifting_events", "figure_4_1", "figure_4_2"),
        log:
            "<logs>/lifting_figures.log",
        benchmark:
            "<benchmarks>/lifting_figures.tsv"
        group:
            "lift_pages"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=140 + 0.2 * len(study.lifts), seconds=4 + len(study.lifts)),
        params:
            code=library_code("lifting_figures.py"),
            pendulum=plain(settings.stability.pendulum),
            source_label=DATA,
        message:
            "Quality of the recordings, Figures 4.1 and 4.2, events of every lift"
        script:
            "../scripts/lifting_figures.py"
