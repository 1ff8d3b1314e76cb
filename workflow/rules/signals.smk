# Excitation signals of the tissue tests, designed from the surgeons' bandwidth: what the testing machine plays.


rule design_signals:
    input:
        bandwidth="<results>/surgeon/bandwidth.json",
    output:
        **published("signal_properties", "excitation_signals"),
        multisine="<results>/signals/multisine.csv",
        noise="<results>/signals/noise.csv",
        chirp="<results>/signals/chirp.csv",
        description="<results>/signals/multisine.json",
        properties="<results>/signals/properties.csv",
    log:
        "<logs>/design_signals.log",
    benchmark:
        "<benchmarks>/design_signals.tsv"
    group:
        "excitation"
    conda:
        CONDA
    resources:
        **job_size(peak_mb=165, seconds=3),
    params:
        code=library_code("design_signals.py"),
        settings=plain(settings.signals),
        seed=settings.seed,
        source_label=DATA,
    message:
        "Excitation signals up to {params.settings[band_factor]} times the surgeons' bandwidth"
    script:
        "../scripts/design_signals.py"
