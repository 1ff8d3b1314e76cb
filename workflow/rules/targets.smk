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
    # sbatch takes a command as one argument of at most 128 KB, and that of a job names all its inputs.
    if (
        len(study.lifts) > 200
        and getattr(workflow.executor_settings, "pass_command_as_script", True) is False
    ):
        raise WorkflowError(f"{len(study.lifts)} lifts on SLURM: add --slurm-pass-command-as-script")
    remove_half_written(workflow.dag.needrun_jobs())
    # Expected seconds of each job, for the time left that the logger of "make" shows.
    seconds = {
        job.jobid: expected_seconds(job.resources.get("runtime")) for job in workflow.dag.needrun_jobs()
    }
    logger.info("", extra={"job_seconds": seconds})
    if study.has("tissue") and settings.tissue.layout.axes:
        print(
            "Records of several axes: Table 3.1 and what is made of its models take one axis and are left out."
        )


onsuccess:
    logs = [at_hand(path) for job in workflow.dag.jobs for path in job.log]
    found = [f"  {line}" for line in summary(Path(at_hand(f"results/{STUDY}")))]
    place = f"Results of the study {STUDY!r} ({study.data_label}): {address(f'results/{STUDY}')}"
    print(*grouped_warnings(logs), place, *found, sep="\n")
    if Path(at_hand(f"results/{STUDY}/report.html")).is_file():
        print(f"Open this page: {address(f'results/{STUDY}/report.html')}")


onerror:
    print("Fix the error above and give the same command again: finished results are kept.")
