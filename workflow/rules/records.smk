# Every recording is read and checked before an analysis uses it. Recordings that are given are all checked by one job, so
# that nothing runs before all of them are valid. Those of the twin are checked by two jobs, lifts and the rest, so that one
# person's lifts can be analysed alone. Its tissue tests are made from signals that are designed from its surgeons' motion,
# which therefore does not wait for the check.


from lumbar.study.study import reading_plan, recordings_of

RECORDED_CHAPTERS = sorted(recordings_of(study))
# Every rule waits for the check, and none re-runs because a recording of another rule was checked again. Rules without
# recordings of their own wait for all of them.
ALL_CHECKED = (
    [] if study.synthetic else [ancient(f"<results>/checked/{chapter}.json") for chapter in RECORDED_CHAPTERS]
)
SURGEON_CHECKED = [] if study.synthetic else ancient("<results>/checked/surgeon.json")


def check_groups():
    """Chapters whose recordings are checked by one job, by the name of the job."""
    if not study.synthetic:
        return {"all": RECORDED_CHAPTERS}
    groups = {"lifting": [], "tissue": []}
    for chapter in RECORDED_CHAPTERS:
        groups["lifting" if chapter == "lifting" else "tissue"].append(chapter)
    return {name: chapters for name, chapters in groups.items() if chapters}


for group, checked in check_groups().items():

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
            "checks"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=90, seconds=2),
        params:
            code=library_code("check_recordings.py"),
            plan=lambda wildcards, chapters=checked: reading_plan(study, chapters),
            source_label=DATA,
        message:
            f"Recordings ({', '.join(checked)}): read and checked"
        script:
            "../scripts/check_recordings.py"
