# Benchmark of the diagnosis: experiments with a hidden effect are made, diagnosed blind, and scored.
# The truth stands in labels/, which only the last rule reads; makes everything in results/hidden_effects/.
#
#   snakemake --cores 2 hidden_effects                                               a quick run
#   snakemake --cores 2 hidden_effects --configfile config/hidden_effects_full.yaml  the whole benchmark

HIDDEN = plain(settings.hidden_effects)
HIDDEN_BATCHES = [
    f"{kind}_{part:02d}"
    for kind, parts in (
        ("single", HIDDEN["experiments_per_form"] * HIDDEN["slices"]),
        ("pair", HIDDEN["experiments_per_pair"] * HIDDEN["slices"]),
        ("outside", HIDDEN["experiments_per_outside_form"] * HIDDEN["slices"]),
        ("null", -(-HIDDEN["nulls"] // HIDDEN["nulls_per_batch"])),
    )
    for part in range(parts)
]
# How many experiments there are, and how they are scored, does not change a single one of them: a larger benchmark
# keeps what a smaller one made. Batches of nulls alone depend on their number, which decides the last one's size.
HIDDEN_COUNTS = {key for key in HIDDEN if key.startswith(("experiments_per_", "nulls"))}
HIDDEN_SCORING = {
    "strong_residual_over_noise",
    "named_share",
    "confidence",
    "bootstrap_resamples",
    "keep_recordings",
}
HIDDEN_NULL = {key: value for key, value in HIDDEN.items() if key not in HIDDEN_SCORING}
HIDDEN_EFFECT = {key: value for key, value in HIDDEN_NULL.items() if key not in HIDDEN_COUNTS}


rule hidden_effects:
    input:
        "results/hidden_effects/scores.csv",


rule make_hidden_effects:
    output:
        recordings=(
            directory("results/hidden_effects/experiments/{kind}_{part}")
            if HIDDEN["keep_recordings"]
            else temp(directory("results/hidden_effects/experiments/{kind}_{part}"))
        ),
        labels="results/hidden_effects/labels/{kind}_{part}.json",
    log:
        "results/hidden_effects/logs/make/{kind}_{part}.log",
    benchmark:
        "results/hidden_effects/benchmarks/make_hidden_effects/{kind}_{part}.tsv"
    wildcard_constraints:
        kind="single|pair|outside|null",
        part=r"\d+",
    group:
        "hidden_effects"
    conda:
        CONDA
    resources:
        **measured(peak_mb=220, seconds=10),
    params:
        code=library_code("make_hidden_effects.py"),
        kind=lambda wildcards: wildcards.kind,
        part=lambda wildcards: int(wildcards.part),
        settings=lambda wildcards: HIDDEN_NULL if wildcards.kind == "null" else HIDDEN_EFFECT,
    message:
        "Experiments with hidden effects: {wildcards.kind} {wildcards.part}"
    script:
        "../scripts/make_hidden_effects.py"


rule diagnose_hidden_effects:
    input:
        recordings="results/hidden_effects/experiments/{kind}_{part}",
    output:
        diagnoses="results/hidden_effects/diagnoses/{kind}_{part}.json",
    log:
        "results/hidden_effects/logs/diagnose/{kind}_{part}.log",
    benchmark:
        "results/hidden_effects/benchmarks/diagnose_hidden_effects/{kind}_{part}.tsv"
    wildcard_constraints:
        kind="single|pair|outside|null",
        part=r"\d+",
    group:
        "hidden_effects"
    conda:
        CONDA
    resources:
        **measured(peak_mb=230, seconds=60),
    params:
        code=library_code("diagnose_hidden_effects.py"),
    message:
        "Blind diagnosis: {wildcards.kind} {wildcards.part}"
    script:
        "../scripts/diagnose_hidden_effects.py"


rule score_hidden_effects:
    input:
        labels=expand("results/hidden_effects/labels/{batch}.json", batch=HIDDEN_BATCHES),
        diagnoses=expand("results/hidden_effects/diagnoses/{batch}.json", batch=HIDDEN_BATCHES),
    output:
        scores="results/hidden_effects/scores.csv",
        confusion="results/hidden_effects/confusion.csv",
        power="results/hidden_effects/power.json",
        accuracy_csv="results/hidden_effects/tables/accuracy.csv",
        accuracy_tex="results/hidden_effects/tables/accuracy.tex",
        accuracy_html="results/hidden_effects/tables/accuracy.html",
        forms_csv="results/hidden_effects/tables/forms.csv",
        forms_tex="results/hidden_effects/tables/forms.tex",
        forms_html="results/hidden_effects/tables/forms.html",
        confusion_svg="results/hidden_effects/figures/confusion.svg",
        confusion_pdf="results/hidden_effects/figures/confusion.pdf",
        power_svg="results/hidden_effects/figures/power.svg",
        power_pdf="results/hidden_effects/figures/power.pdf",
    log:
        "results/hidden_effects/logs/score.log",
    benchmark:
        "results/hidden_effects/benchmarks/score_hidden_effects.tsv"
    conda:
        CONDA
    resources:
        **measured(peak_mb=220, seconds=20),
    params:
        code=library_code("score_hidden_effects.py"),
        settings=HIDDEN,
    message:
        "Scores of the diagnosis"
    script:
        "../scripts/score_hidden_effects.py"
