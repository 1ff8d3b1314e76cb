# The run as one archive that can be cited: code, inputs, environment and outputs, described as a Workflow Run RO-Crate.


CRATE_PARTS = ("config", "envs", "profiles", "resources", "workflow")
CRATE_FILES = ("Snakefile", "pyproject.toml", "Makefile", "README.md", "LICENSE", "CITATION.cff")


def project_files(wildcards=None):
    """Names of the project's files, below its folder."""
    root = Path(workflow.basedir)
    parts = [path for part in CRATE_PARTS for path in (root / part).rglob("*") if path.is_file()]
    kept = [path for path in parts if "__pycache__" not in path.parts]
    present = [root / name for name in CRATE_FILES if (root / name).is_file()]
    return sorted(path.relative_to(root).as_posix() for path in kept + present)


CRATE_RESULTS = {
    f"results/{STUDY}/{path}": "" if "{" in label else label
    for artefact in ARTEFACTS
    for path, label in artefact.labelled(study.lifts)
}


localrules:
    run_crate,


rule run_crate:
    input:
        results=made(ARTEFACTS),
        config="<results>/run_config.yaml",
        environment="<results>/run_environment.json",
        checked=[f"<results>/checked/{chapter}.json" for chapter in RECORDED_CHAPTERS],
        project=lambda wildcards: [source(Path(workflow.basedir) / name) for name in project_files()],
    output:
        crate=f"<results>/{STUDY}.crate.zip",
    log:
        "<logs>/run_crate.log",
    benchmark:
        "<benchmarks>/run_crate.tsv"
    conda:
        CONDA
    resources:
        **measured(peak_mb=200, seconds=1),
    params:
        study=STUDY,
        title=settings.title,
        data=DATA,
        source={} if study.synthetic else plain(settings.data_source),
        epoch=DECLARED_EPOCH,
        results=CRATE_RESULTS,
        configuration=f"results/{STUDY}/run_config.yaml",
        environment=f"results/{STUDY}/run_environment.json",
        project=project_files,
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
