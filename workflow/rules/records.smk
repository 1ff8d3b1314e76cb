# Every recording is read and checked before an analysis uses it. Recordings that are given are all checked by one
# job, so that nothing runs before all of them are sound; the twin's are checked chapter by chapter, since its tissue
# tests are made from signals that are designed from its surgeon's motion.


from lumbar.study.study import reading_plan, recordings_of

RECORDED_CHAPTERS = sorted(recordings_of(study))
# What rules without recordings of their own wait for: nothing is made from a study whose recordings are not sound.
ALL_CHECKED = (
    [] if study.synthetic else [f"<results>/checked/{chapter}.json" for chapter in RECORDED_CHAPTERS]
)
CHECKS = (
    {chapter: [chapter] for chapter in RECORDED_CHAPTERS} if study.synthetic else {"all": RECORDED_CHAPTERS}
)
# With what else the checks of a chapter are submitted to a cluster.
CHECK_GROUPS = {
    "surgeon": "excitation",
    "tissue": "excitation",
    "lifting": "lifts",
    "improvement": "improvement_records",
}


for group, checked in CHECKS.items():

    rule:
        name:
            f"check_{group}_recordings"
        input:
            recordings=lambda wildcards, chapters=checked: [
                placed(item["path"]) for item in reading_plan(study, chapters)
            ],
        output:
            [f"<results>/checked/{chapter}.json" for chapter in checked],
        log:
            f"<logs>/check_{group}_recordings.log",
        benchmark:
            f"<benchmarks>/check_{group}_recordings.tsv"
        group:
            CHECK_GROUPS.get(group, group)
        conda:
            CONDA
        resources:
            **job_size(peak_mb=90, seconds=2),
        params:
            code=library_code("check_recordings.py"),
            plan=lambda wildcards, chapters=checked: reading_plan(study, chapters),
            data=DATA,
        message:
            f"Recordings ({', '.join(checked)}): read and checked"
        script:
            "../scripts/check_recordings.py"
