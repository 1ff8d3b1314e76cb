# Motion of the surgeons' tool: power spectral densities of all trials, bandwidth by two rules with intervals.


rule surgeon_motion:
    input:
        records=[recording(record.file) for record in settings.surgeon.records],
        checked=SURGEON_CHECKED,
    output:
        **published("surgeon_psd"),
        bandwidth="<results>/surgeon/bandwidth.json",
        psd="<results>/surgeon/psd.csv",
    log:
        "<logs>/surgeon_motion.log",
    benchmark:
        "<benchmarks>/surgeon_motion.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=195, seconds=7),
    params:
        code=library_code("surgeon_motion.py"),
        settings=plain(settings.surgeon),
        seed=settings.seed,
        source_label=DATA,
    message:
        "Bandwidth of the surgeons' motion"
    script:
        "../scripts/surgeon_motion.py"
