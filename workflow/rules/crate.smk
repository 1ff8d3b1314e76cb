# The run as one archive that can be cited: code, inputs, environment and outputs, described as a Workflow Run RO-Crate.

from run.project_files import project_files


localrules:
    run_crate,


rule run_crate:
    input:
        results=lambda wildcards: made(ARTEFACTS),
        config="<results>/run_config.yaml",
        environment="<results>/run_environment.json",
        checked=[f"<results>/checked/{chapter}.json" for chapter in RECORDED_CHAPTERS],
        project=lambda wildcards: [
            source(Path(workflow.basedir) / name) for name in project_files(Path(workflow.basedir))
        ],
    output:
        crate=f"<results>/{STUDY}.crate.zip",
    log:
        "<logs>/run_crate.log",
    benchmark:
        "<benchmarks>/run_crate.tsv"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=200, seconds=1),
    params:
        study=STUDY,
        title=lambda wildcards: settings.title,
        data=DATA,
        source={} if study.synthetic else plain(settings.data_source),
        epoch=DECLARED_EPOCH,
        results=lambda wildcards: {
            path: "" if "{" in label else label
            for artefact in ARTEFACTS
            for path, label in artefact.labelled(study.lifts)
        },
        project=lambda wildcards: project_files(Path(workflow.basedir)),
        code=library_code("run_crate.py"),
    message:
        "The run as an archive: code, inputs, environment, outputs"
    script:
        "../scripts/run_crate.py"


rule crate:
    input:
        rules.run_crate.output,
    message:
        f"Study {STUDY}: an archive that can be cited"
