"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run, stem


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.diagnosis.evidence.diagnosis_files import write_diagnosis
    from lumbar.diagnosis.evidence.evidence import gather_evidence
    from lumbar.diagnosis.fitting.diagnosis_settings import DiagnosisSettings
    from lumbar.diagnosis.residuals.compare import comparison_table
    from lumbar.diagnosis.residuals.locate import location_table
    from lumbar.diagnosis.residuals.residual_report import compare_and_locate
    from lumbar.diagnosis.selection.diagnose import diagnose
    from lumbar.diagnosis.selection.refined_model import refined_document
    from lumbar.files import write_json, write_text
    from lumbar.records.columns import read_record
    from lumbar.reports.pages.diagnosis_page import diagnosis_page
    from lumbar.reports.pages.diagnosis_pictures import draw_pictures
    from lumbar.settings.improvement import ImprovementSettings
    from lumbar.settings.layout import ColumnLayout
    from lumbar.settings.plain import typed
    from lumbar.settings.signals import MachineSettings

    layout = typed(ColumnLayout, params.layout)
    records = [
        read_record(path, layout, entry["name"], entry["period_s"], params.rate)
        for entry, path in zip(params.records, input.recordings, strict=True)
    ]
    settings = DiagnosisSettings.from_improvement(typed(ImprovementSettings, params.improvement), params.base)
    folder = Path(output.refined).parent
    diagnosis = diagnose(records, settings)
    evidence = gather_evidence(
        diagnosis, records, settings, params.seed, typed(MachineSettings, params.machine)
    )
    floor, training = diagnosis.experiment.floor, diagnosis.experiment.floor_from
    simulated = compare_and_locate(records, diagnosis.base.fit, floor, training, params.seed, settings.centre)
    pictures = draw_pictures(diagnosis, simulated, settings.candidates, folder, params.data)
    comparisons = comparison_table([item.comparison for item in simulated], params.data)
    comparisons.write(stem(output.comparisons))
    locations = location_table([item.location for item in simulated], params.data)
    locations.write(stem(output.locations))
    write_json(output.refined, refined_document(diagnosis.ladder, diagnosis.experiment, params.data))
    page = diagnosis_page(diagnosis, evidence, settings.candidates, params.data, pictures)
    write_text(folder / "diagnosis.html", page)
    write_diagnosis(diagnosis, evidence, folder, params.data)


run(main, snakemake)
