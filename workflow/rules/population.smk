# From the marker files of every person to the measures of all, and to what differs between groups and boxes: one job per
# person, since a job for every lift would spend more on its start than on the lift.


if study.has("population"):

    PERSON_LIFTS = study.lifts_by_person

    rule measure_person:
        input:
            markers=lambda wildcards: [
                recording(lift.trial.markers) for lift in PERSON_LIFTS[wildcards.person].values()
            ],
            static=lambda wildcards: [
                recording(path) for path in [study.subjects[wildcards.person].static] if path is not None
            ],
            checked=ALL_CHECKED,
        output:
            measures="<results>/population/persons/{person}.csv",
        log:
            "<logs>/measure_person/{person}.log",
        benchmark:
            "<benchmarks>/measure_person/{person}.tsv"
        group:
            "person"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=210, seconds=9),
        params:
            code=library_code("measure_person.py"),
            subject=lambda wildcards: plain(study.subjects[wildcards.person], {*LIFTER, "static"}),
            trials=lambda wildcards: {
                name: plain(lift.trial) for name, lift in PERSON_LIFTS[wildcards.person].items()
            },
            lifting=plain(settings.lifting, LIFT),
            stability=plain(settings.stability, MEASURED),
            source_label=DATA,
        message:
            "{wildcards.person}: measures of every lift"
        script:
            "../scripts/measure_person.py"

    rule compare_people:
        input:
            persons=[f"<results>/population/persons/{person}.csv" for person in study.subjects],
        output:
            **published("measure_comparison", "measure_comparison_figure"),
            measures="<results>/population/measures.csv",
        log:
            "<logs>/compare_people.log",
        benchmark:
            "<benchmarks>/compare_people.tsv"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=205 + 0.03 * len(study.lifts), seconds=10 + 0.01 * len(study.lifts)),
        params:
            code=library_code("compare_people.py"),
            groups=lambda wildcards: list(settings.stability.compare.groups),
            labels=study.labels,
            source_label=DATA,
        message:
            "Groups of people and their boxes compared"
        script:
            "../scripts/compare_people.py"
