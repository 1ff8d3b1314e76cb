# Improvement: what the base model is missing on each record set, the model with it, and the error ladder.

from lumbar.study.study import record_set, settings_of_set

RECORD_SET_CHAPTERS = ("tissue", "improvement")
DIAGNOSED = {
    "improvement": {"train", "forward", "session", "effect_files", "most_effects", "propose_law"},
    # The thesis's models are compared too.
    "tissue": {
        "layout",
        "rate_Hz",
        "settling_s",
        "force_frame",
        "search",
        "ridge",
        "bootstrap",
        "inverted_linear",
    },
    "signals": {"machine"},
    "stability": {"pendulum": {"gravity_m_s2"}},
    "seed": True,
}
RECORD_SETS = [entry.name for entry in settings.improvement.record_sets]


rule diagnose_records:
    input:
        recordings=lambda wildcards: [
            recording(record.file) for record in record_set(settings, wildcards.record_set).records
        ],
        checked=[
            ancient(f"<results>/checked/{chapter}.json")
            for chapter in RECORDED_CHAPTERS
            if chapter in RECORD_SET_CHAPTERS
        ],
        effects=EFFECT_FILES,
        bases=BASE_FILES,
    output:
        **published(
            "diagnoses",
            "comparisons",
            "locations",
            "comparison_figures",
            "location_figures",
            "effect_signatures",
            "error_ladders",
            *(["principal_axes"] if settings.tissue.layout.axes else []),
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
    resources:
        **job_size(peak_mb=230, seconds=15),
    params:
        code=library_code("diagnose_records.py"),
        records=lambda wildcards: [plain(item) for item in record_set(settings, wildcards.record_set).records],
        effects=lambda wildcards: plain(record_set(settings, wildcards.record_set), {"effects"})["effects"],
        base=lambda wildcards: settings_of_set(settings, wildcards.record_set).improvement.base,
        settings=lambda wildcards: plain(settings_of_set(settings, wildcards.record_set), DIAGNOSED),
        source_label=DATA,
    message:
        "{wildcards.record_set}: what the model is missing"
    script:
        "../scripts/diagnose_records.py"
