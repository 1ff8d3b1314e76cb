# Named targets: one per chapter and one per artefact.


for chapter in settings.chapters:

    rule:
        name:
            chapter
        input:
            made([artefact for artefact in ARTEFACTS if artefact.chapter == chapter]),
        message:
            f"Chapter {chapter}: everything is made"


for artefact in ARTEFACTS:

    rule:
        name:
            artefact.id
        input:
            made([artefact]),
        message:
            f"{artefact.id}: everything is made"


onstart:
    remove_half_written(workflow)
    lift_limit(workflow.scheduler)
    end_when_told(workflow)
    fork_scripts(workflow)
    RUN["log"] = watch(workflow, STAGES, BENCHMARKS)
    if study.has("tissue") and settings.tissue.layout.axes:
        print(
            "Records of several axes: Table 3.1 and what is made of its models take one axis and are left out."
        )


onsuccess:
    closing = RUN["log"].closing(BENCHMARKS)
    missing = Path(at_hand(f"results/{STUDY}/stability/failures.csv"))
    failed = announcement(missing) if study.has("stability") and missing.is_file() else ""
    print(closing if failed in closing else f"{closing}\n{failed}")
    print(f"Results of the study {STUDY!r} ({study.data_label}): {address(f'results/{STUDY}')}")
    if Path(at_hand(f"results/{STUDY}/report.html")).is_file():
        print(f"All of it on one page: {address(f'results/{STUDY}/report.html')}")


onerror:
    print(RUN["log"].closing(BENCHMARKS))
    print("Mend what is said above and give the same command again: what is done stays.")
