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
        diagnosis="<results>/improvement/{record_set}/diagnosis.json",
        page=report(
            "<results>/improvement/{record_set}/diagnosis.html",
            caption=caption("diagnosis"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Diagnosis of the records {record_set}"},
        ),
        ladder="<results>/improvement/{record_set}/ladder.csv",
        refined="<results>/improvement/{record_set}/refined.json",
        compare="<results>/improvement/{record_set}/compare.csv",
        compare_tex="<results>/improvement/{record_set}/compare.tex",
        compare_html=report(
            "<results>/improvement/{record_set}/compare.html",
            caption=caption("comparison"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Base model against the records {record_set}"},
        ),
        location="<results>/improvement/{record_set}/location.csv",
        location_tex="<results>/improvement/{record_set}/location.tex",
        location_html=report(
            "<results>/improvement/{record_set}/location.html",
            caption=caption("location"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Where the base model fails on the records {record_set}"},
        ),
        comparison_svg=report(
            "<results>/improvement/{record_set}/comparison.svg",
            caption=caption("comparison_figure"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Base model beside the least explained of the records {record_set}"},
        ),
        comparison_pdf="<results>/improvement/{record_set}/comparison.pdf",
        location_svg=report(
            "<results>/improvement/{record_set}/location.svg",
            caption=caption("location_figure"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Where the base model fails: pictures of the records {record_set}"},
        ),
        location_pdf="<results>/improvement/{record_set}/location.pdf",
        signatures_svg=report(
            "<results>/improvement/{record_set}/signatures.svg",
            caption=caption("signatures"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Signatures of the effects named for the records {record_set}"},
        ),
        signatures_pdf="<results>/improvement/{record_set}/signatures.pdf",
        ladder_svg=report(
            "<results>/improvement/{record_set}/ladder.svg",
            caption=caption("error_ladder"),
            category=CATEGORIES["improvement"],
            labels={"artefact": "Error ladder of the records {record_set}"},
        ),
        ladder_pdf="<results>/improvement/{record_set}/ladder.pdf",
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
        layout=lambda wildcards: plain(
            record_layout(settings, record_set(settings, wildcards.record_set).base)[0]
        ),
        rate=lambda wildcards: record_layout(settings, record_set(settings, wildcards.record_set).base)[1],
        improvement=without(settings.improvement, "record_sets"),
        machine=plain(settings.signals.machine),
        seed=settings.seed,
        data=DATA,
    message:
        "{wildcards.record_set}: what the model is missing"
    script:
        "../scripts/diagnose_records.py"
