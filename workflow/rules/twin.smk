# The synthetic twin: recordings in the formats a laboratory would bring, made from one seeded configuration.

from lumbar.study.study import HIP_MOMENTS, TWIN_HIP_MOMENT, TWIN_MARKERS


rule twin_recordings:
    input:
        answers=source("resources/survey/survey_reconstructed.csv"),
    output:
        surgeon=[f"<results>/twin/{record.file}" for record in settings.surgeon.records],
        two_hidden_effects=expand(
            "<results>/twin/two_hidden_effects/{name}.csv", name=["multisine", "noise", "chirp"]
        ),
        answers=f"<results>/twin/{settings.survey.file}",
    log:
        "<logs>/twin_recordings.log",
    benchmark:
        "<benchmarks>/twin_recordings.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=125, seconds=4),
    params:
        code=library_code("twin_recordings.py"),
        records=[plain(record, {"name", "surgeon"}) for record in settings.surgeon.records],
        surgeon=plain(settings.twin.surgeon),
        two_hidden=plain(settings.twin.two_hidden_effects),
        seed=settings.twin.seed,
    message:
        "Synthetic motion of the surgeons' tool, tissue tests with two hidden effects, survey answers"
    script:
        "../scripts/twin_recordings.py"


if study.cohort:

    from lumbar.twin.cohort import cohort_lifts, marker_file, single_person_cohort

    RECORDING = {"rate_Hz", "duration_s", "marker_noise_mm", "gaps", "workplace"}
    COHORT_LIFTS = list(cohort_lifts(study.cohort))

    rule twin_person:
        output:
            markers=[f"<results>/twin/{marker_file('{person}', *lift)}" for lift in COHORT_LIFTS],
        log:
            "<logs>/twin_person/{person}.log",
        benchmark:
            "<benchmarks>/twin_person/{person}.tsv"
        group:
            "person"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=50, seconds=1),
        params:
            code=library_code("twin_person.py"),
            # Without the other groups and the numbers of subjects: an added subject does not re-run the others.
            settings=plain(settings.twin.lifting, RECORDING),
            cohort=lambda wildcards: plain(
                single_person_cohort(study.cohort, study.subjects[wildcards.person].experience)
            ),
            person="{person}",
            group=lambda wildcards: study.subjects[wildcards.person].experience,
            seed=settings.twin.seed,
        message:
            "{wildcards.person}: synthetic lifts"
        script:
            "../scripts/twin_person.py"

elif study.synthetic and study.lifts:

    from lumbar.twin.cohort import single_lift_settings

    rule twin_lift:
        output:
            markers=f"<results>/twin/{TWIN_MARKERS}",
            hip_moment=f"<results>/twin/{TWIN_HIP_MOMENT}",
        log:
            "<logs>/twin_lift/{lift}.log",
        benchmark:
            "<benchmarks>/twin_lift/{lift}.tsv"
        group:
            "lifts"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=120, seconds=1),
        params:
            code=library_code("twin_lift.py"),
            # Without other subjects and their lifts: an added subject does not re-run the others.
            settings=lambda wildcards: plain(
                single_lift_settings(
                    settings.twin.lifting,
                    study.subjects[study.lifts[wildcards.lift].subject],
                    wildcards.lift,
                    study.lifts[wildcards.lift].trial.box_mass_kg,
                    settings.twin.seed,
                )
            ),
            lift="{lift}",
            gravity=settings.stability.pendulum.gravity_m_s2,
            seed=settings.twin.seed,
        message:
            "{wildcards.lift}: synthetic lift, marker file and hip moment"
        script:
            "../scripts/twin_lift.py"


TRIALS = [
    record
    for entry in settings.improvement.record_sets
    for record in entry.records or ()
    if record.file.startswith(HIP_MOMENTS)
]


if study.synthetic and TRIALS:

    from lumbar.twin.lifting_recordings import select_lifts

    rule twin_hip_moment:
        output:
            recordings=[f"<results>/twin/{record.file}" for record in TRIALS],
        log:
            "<logs>/twin_hip_moment.log",
        benchmark:
            "<benchmarks>/twin_hip_moment.tsv"
        group:
            "improvement_records"
        conda:
            CONDA
        resources:
            **job_size(peak_mb=120, seconds=2),
        params:
            code=library_code("twin_hip_moment.py"),
            settings=plain(
                select_lifts(
                    settings.twin.lifting,
                    [settings.twin.lifting.hip_moment.trials[record.name].lift for record in TRIALS],
                )
            ),
            trials=[record.name for record in TRIALS],
            gravity=settings.stability.pendulum.gravity_m_s2,
            seed=settings.twin.seed,
        message:
            "Synthetic hip moments of repeated lifts"
        script:
            "../scripts/twin_hip_moment.py"


rule twin_tissue:
    input:
        signals=expand("<results>/signals/{name}.csv", name=["multisine", "noise", "chirp"]),
    output:
        recordings=expand("<results>/twin/tissue/{name}.csv", name=["multisine", "noise", "chirp"]),
    log:
        "<logs>/twin_tissue.log",
    benchmark:
        "<benchmarks>/twin_tissue.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=45, seconds=1),
    params:
        code=library_code("twin_tissue.py"),
        tissue=plain(settings.twin.tissue),
        seed=settings.twin.seed,
    message:
        "Synthetic tissue tests: the excitation signals played on a hardening Kelvin–Boltzmann tissue"
    script:
        "../scripts/twin_tissue.py"
