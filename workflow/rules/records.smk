# Every recording is read and checked before an analysis uses it. Recordings that are given are all checked by one
# job, so that nothing runs before all of them are sound; the twin's are checked chapter by chapter, since its tissue
# tests are made from signals that are designed from its surgeon's motion.


from lumbar.config import reading_plan, recordings_of

RECORDED_CHAPTERS = sorted(recordings_of(study))


if study.synthetic:

    rule check_recordings:
        input:
            recordings=lambda wildcards: [item["path"] for item in reading_plan(study, [wildcards.chapter])],
            sources=library_sources("check_recordings.py"),
        output:
            "<results>/checked/{chapter}.json",
        log:
            "<logs>/check_recordings/{chapter}.log",
        benchmark:
            "<benchmarks>/check_recordings/{chapter}.tsv"
        wildcard_constraints:
            chapter="|".join(RECORDED_CHAPTERS) or "none",
        conda:
            CONDA
        params:
            plan=lambda wildcards: reading_plan(study, [wildcards.chapter]),
            data=DATA,
        message:
            "Recordings of chapter {wildcards.chapter}: read and checked"
        script:
            "../scripts/check_recordings.py"

else:

    rule check_recordings:
        input:
            recordings=[item["path"] for item in reading_plan(study, RECORDED_CHAPTERS)],
            sources=library_sources("check_recordings.py"),
        output:
            [f"<results>/checked/{chapter}.json" for chapter in RECORDED_CHAPTERS],
        log:
            "<logs>/check_recordings.log",
        benchmark:
            "<benchmarks>/check_recordings.tsv"
        conda:
            CONDA
        params:
            plan=reading_plan(study, RECORDED_CHAPTERS),
            data=DATA,
        message:
            "All recordings of the study: read and checked"
        script:
            "../scripts/check_recordings.py"
