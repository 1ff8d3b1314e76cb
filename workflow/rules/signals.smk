# Excitation signals of the tissue tests, designed from the surgeons' bandwidth: what the testing machine plays.


rule design_signals:
    input:
        bandwidth="<results>/surgeon/bandwidth.json",
        sources=library_sources("design_signals.py"),
    output:
        multisine="<results>/signals/multisine.csv",
        noise="<results>/signals/noise.csv",
        chirp="<results>/signals/chirp.csv",
        description="<results>/signals/multisine.json",
        properties="<results>/signals/properties.csv",
        csv="<results>/tables/signal_properties.csv",
        tex="<results>/tables/signal_properties.tex",
        html=report(
            "<results>/tables/signal_properties.html",
            caption=caption("signal_properties"),
            category=CATEGORIES["signals"],
            labels={"artefact": "Properties of the excitation signals"},
        ),
        svg=report(
            "<results>/figures/excitation_signals.svg",
            caption=caption("excitation_signals"),
            category=CATEGORIES["signals"],
            labels={"artefact": "Excitation signals"},
        ),
        pdf="<results>/figures/excitation_signals.pdf",
    log:
        "<logs>/design_signals.log",
    benchmark:
        "<benchmarks>/design_signals.tsv"
    conda:
        CONDA
    params:
        settings=plain(settings.signals),
        seed=settings.seed,
        data=DATA,
    message:
        "Excitation signals up to {params.settings[band_factor]} times the surgeons' bandwidth"
    script:
        "../scripts/design_signals.py"
