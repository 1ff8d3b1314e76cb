"""Identification of every tissue model on one training record."""

from job import run


def main(input, output, params):
    """Read the records, identify the models, write fits and search grid."""
    import pandas as pd

    from lumbar.files import write_csv, write_json
    from lumbar.identification.identify_tissue import identify
    from lumbar.identification.models_file import inverted_linear_fit
    from lumbar.records.columns import read_record
    from lumbar.settings.improvement import ImprovementSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.tissue import TissueSettings

    tissue, improvement = typed(TissueSettings, params.tissue), typed(ImprovementSettings, params.improvement)
    records = {
        entry.name: read_record(path, tissue.layout, entry.name, entry.period_s, tissue.rate_Hz)
        for entry, path in zip(tissue.records, input.recordings, strict=True)
    }
    training = records.pop(params.training)
    tests = list(records.values())
    result = identify(training, tests, tissue, params.seed)
    given = inverted_linear_fit(training, tests, tissue.settling_s, **vars(tissue.inverted_linear))
    result["fits"].append(given)
    if improvement.effects:
        from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
        from lumbar.diagnosis.selection.refined_row import refined_fit

        settings = DiagnosisSettings.from_improvement(improvement, train=training.name)
        result["fits"].append(refined_fit([training, *tests], improvement.effects, settings))
    write_csv(output.grid, pd.DataFrame(result.pop("grid")).assign(data=params.data))
    write_json(output.fits, {**result, "data": params.data})


run(main, snakemake)
