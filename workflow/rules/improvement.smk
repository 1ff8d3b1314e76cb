# Improvement: what the base model is missing on each record set, the model with it, and the error ladder.

from lumbar.config.study_recordings import record_layout, record_set_base, record_set_records

RECORD_SET_CHAPTERS = ("tissue", "improvement")
RECORD_SETS = [entry["name"] for entry in config["improvement"]["record_sets"]]


rule diagnose_records:
    input:
        recordings=lambda wildcards: [
            recording(record["file"]) for record in record_set_records(study, wildcards.record_set)
        ],
        checked=[
            f"<results>/checked/{chapter}.json"
            for chapter in RECORDED_CHAPTERS
            if chapter in RECORD_SET_CHAPTERS
        ],
        effects=config["improvement"]["effect_files"],
        sources=library_sources("diagnose_records.py"),
    output:
        **published(
            "diagnoses",
            "comparisons",
            "locations",
            "comparison_figures",
            "location_figures",
            "effect_signatures",
            "error_ladders",
        ),
        refined="<results>/improvement/{record_set}/refined.json",
    log:
        "<logs>/diagnose_records/{record_set}.log",
    benchmark:
        "<benchmarks>/diagnose_records/{record_set}.tsv"
    wildcard_constraints:
        record_set="|".join(RECORD_SETS) or "none",
    conda:
        CONDA
    params:
        records=lambda wildcards: record_set_records(study, wildcards.record_set),
        base=lambda wildcards: record_set_base(config, wildcards.record_set),
        layout=lambda wildcards: record_layout(config, record_set_base(config, wildcards.record_set))[0],
        rate=lambda wildcards: record_layout(config, record_set_base(config, wildcards.record_set))[1],
        improvement={key: value for key, value in config["improvement"].items() if key != "record_sets"},
        machine=config["signals"]["machine"],
        seed=config["seed"],
        data=DATA,
    message:
        "{wildcards.record_set}: what the model is missing"
    script:
        "../scripts/diagnose_records.py"
