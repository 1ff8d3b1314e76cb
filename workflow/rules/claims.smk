# Chapter 8, claims: what the thesis says against what this run shows; the run's settings.


rule run_config:
    input:
        checked=ALL_CHECKED,
    output:
        config="<results>/run_config.yaml",
        environment="<results>/run_environment.json",
    log:
        "<logs>/run_config.log",
    benchmark:
        "<benchmarks>/run_config.tsv"
    group:
        "claims"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=50, seconds=1),
    params:
        code=lambda wildcards: [library_code("run_config.py"), describe_environment()],
        config=plain(settings),
        subjects={name: plain(subject) for name, subject in study.subjects.items()},
        source_label=DATA,
    message:
        "Settings, seeds and versions of this run"
    script:
        "../scripts/run_config.py"


# Files that the claims are judged on. If a study does not make one, its claims are reported as untestable.
EVIDENCE = {
    "bandwidth": "surgeon/bandwidth.json",
    "multisine": "signals/multisine.json",
    "table_3_1": "tables/table_3_1.csv",
    "models": "tissue/models.json",
    "survey": "survey/survey.json",
    "table_3_2": "tables/table_3_2.csv",
    "table_4_1": "tables/table_4_1.csv",
    "table_4_1_controls": "tables/table_4_1_controls.csv",
    "boa": "stability/boa.csv",
}
MADE = {path for artefact in ARTEFACTS for path in artefact.paths()}
EVIDENCE = {name: path for name, path in EVIDENCE.items() if path in MADE}


rule examine_claims:
    input:
        published=[source(f"resources/thesis/{name}.csv") for name in ("table_3_1", "table_3_2", "table_4_1")],
        results=[f"<results>/{path}" for path in EVIDENCE.values()],
    output:
        **published("claims_table"),
        claims="<results>/claims.csv",
    log:
        "<logs>/examine_claims.log",
    benchmark:
        "<benchmarks>/examine_claims.tsv"
    group:
        "claims"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=80, seconds=2),
    params:
        code=library_code("claims.py"),
        names=list(EVIDENCE),
        synthetic=study.synthetic,
        groups=lambda wildcards: list(settings.stability.compare.groups),
        source_label=DATA,
    message:
        "Claims: the thesis's values against this run's"
    script:
        "../scripts/claims.py"
