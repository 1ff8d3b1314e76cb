# The synthetic twin: recordings in the formats a laboratory would bring, made from one seeded configuration.


rule twin_survey:
    input:
        answers=str(Path(workflow.basedir) / "resources" / "survey" / "survey_reconstructed.csv"),
        sources=library_sources("twin_survey.py"),
    output:
        answers=f"<results>/twin/{config['survey']['file']}",
    log:
        "<logs>/twin_survey.log",
    benchmark:
        "<benchmarks>/twin_survey.tsv"
    conda:
        CONDA
    message:
        "Survey answers that fit the published margins"
    script:
        "../scripts/twin_survey.py"


rule twin_surgeon:
    input:
        sources=library_sources("twin_surgeon.py"),
    output:
        recordings=[f"<results>/twin/{record['file']}" for record in config["surgeon"]["records"]],
    log:
        "<logs>/twin_surgeon.log",
    benchmark:
        "<benchmarks>/twin_surgeon.tsv"
    conda:
        CONDA
    params:
        records=[{key: record[key] for key in ("name", "surgeon")} for record in config["surgeon"]["records"]],
        settings=config["twin"]["surgeon"],
        seed=config["twin"]["seed"],
    message:
        "Synthetic motion of the surgeons' tool"
    script:
        "../scripts/twin_surgeon.py"


if study.synthetic and study.has("lifting"):

    rule twin_lifting:
        input:
            sources=library_sources("twin_lifting.py"),
        output:
            markers=[recording(trial["markers"]) for trial in study.lifts.values()],
            hip_moment=[
                recording(trial["hip_moment"]) for trial in study.lifts.values() if "hip_moment" in trial
            ],
        log:
            "<logs>/twin_lifting.log",
        benchmark:
            "<benchmarks>/twin_lifting.tsv"
        conda:
            CONDA
        params:
            settings=config["twin"]["lifting"],
            lifts=list(study.lifts),
            with_moment=[lift for lift, trial in study.lifts.items() if "hip_moment" in trial],
            seed=config["twin"]["seed"],
        message:
            "Synthetic lifts: marker files and hip moments"
        script:
            "../scripts/twin_lifting.py"


HIP_MOMENTS = [
    record
    for entry in config["improvement"]["record_sets"]
    for record in entry.get("records", [])
    if record["file"].startswith("hip_moment/")
]


if study.synthetic and HIP_MOMENTS:

    rule twin_hip_moment:
        input:
            sources=library_sources("twin_hip_moment.py"),
        output:
            recordings=[f"<results>/twin/{record['file']}" for record in HIP_MOMENTS],
        log:
            "<logs>/twin_hip_moment.log",
        benchmark:
            "<benchmarks>/twin_hip_moment.tsv"
        conda:
            CONDA
        params:
            settings=config["twin"]["lifting"],
            trials=[record["name"] for record in HIP_MOMENTS],
            seed=config["twin"]["seed"],
        message:
            "Synthetic hip moments of repeated lifts"
        script:
            "../scripts/twin_hip_moment.py"


rule twin_tissue:
    input:
        signals=expand("<results>/signals/{name}.csv", name=["multisine", "noise", "chirp"]),
        sources=library_sources("twin_tissue.py"),
    output:
        recordings=expand("<results>/twin/tissue/{name}.csv", name=["multisine", "noise", "chirp"]),
    log:
        "<logs>/twin_tissue.log",
    benchmark:
        "<benchmarks>/twin_tissue.tsv"
    conda:
        CONDA
    params:
        tissue=config["twin"]["tissue"],
        seed=config["twin"]["seed"],
    message:
        "Synthetic tissue tests: the excitation signals played on a hardening Kelvin–Boltzmann tissue"
    script:
        "../scripts/twin_tissue.py"


rule twin_two_hidden_effects:
    input:
        sources=library_sources("twin_two_hidden_effects.py"),
    output:
        recordings=expand(
            "<results>/twin/two_hidden_effects/{name}.csv", name=["multisine", "noise", "chirp"]
        ),
    log:
        "<logs>/twin_two_hidden_effects.log",
    benchmark:
        "<benchmarks>/twin_two_hidden_effects.tsv"
    conda:
        CONDA
    params:
        twin={key: config["twin"][key] for key in ("seed", "two_hidden_effects")},
        generator=config["hidden_effects"],
    message:
        "Synthetic tissue tests with two hidden effects"
    script:
        "../scripts/twin_two_hidden_effects.py"
