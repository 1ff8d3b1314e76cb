# Improvement: what the base model is missing on each record set, the model with it, and the error ladder.

from lumbar.config.study_recordings import record_layout, record_set

RECORD_SET_CHAPTERS = ("tissue", "improvement")
RECORD_SETS = [entry.name for entry in settings.improvement.record_sets]


rule diagnose_records:
    input:
        recordings=lambda wildcards: [
            recording(record.file) for record in record_set(settings, wildcards.record_set).records
        ],
        checked=[
            f"<results>/checked/{chapter}.json"
            for chapter in RECORDED_CHAPTERS
            if chapter in RECORD_SET_CHAPTERS
        ],
        effects=list(settings.improvement.effect_files),
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
        records=lambda wildcards: plain(record_set(settings, wildcards.record_set).records),
        base=lambda wildcards: record_set(settings, wildcards.record_set).base,
        session=lambda wildcards: record_set(settings, wildcards.record_set).session,
        layout=lambda wildcards: plain(
            record_layout(settings, record_set(settings, wildcards.record_set).base)[0]
        ),
        rate=lambda wildcards: record_layout(settings, record_set(settings, wildcards.record_set).base)[1],
        improvement=without(settings.improvement, "record_sets"),
        machine=plain(settings.signals.machine),
        tissue=without(settings.tissue, "records", "training", "layout", "rate_Hz"),
        gravity=settings.stability.pendulum.gravity_m_s2,
        seed=settings.seed,
        data=DATA,
    message:
        "{wildcards.record_set}: what the model is missing"
    script:
        "../scripts/diagnose_records.py"
