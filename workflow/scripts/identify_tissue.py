"""Identification of every tissue model on one training record."""

from job import run


def main(input, output, params):
    """Read the records, identify the models, write fits and search grid."""
    import pandas as pd

    from lumbar.files import write_csv, write_json
    from lumbar.identification.identify_tissue import given_model, identify
    from lumbar.models.models_file import models_document
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
    models, grid = identify(training, tests, tissue, params.seed)
    models.append(given_model(training, tests, tissue.settling_s, **vars(tissue.inverted_linear)))
    if improvement.effects:
        from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
        from lumbar.diagnosis.selection.refine import refined_fit

        settings = DiagnosisSettings.from_improvement(improvement, train=training.name)
        models.append(refined_fit([training, *tests], improvement.effects, settings))
    write_csv(output.grid, pd.DataFrame(grid).assign(data=params.data))
    write_json(output.fits, models_document(models, params.data))


run(main, snakemake)
