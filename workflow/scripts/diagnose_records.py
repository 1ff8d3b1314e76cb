"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.files import write_json, write_text
    from lumbar.improvement.compare import comparison_table
    from lumbar.improvement.diagnose import diagnose
    from lumbar.improvement.evidence import gather_evidence
    from lumbar.improvement.locate import location_table
    from lumbar.improvement.refined_model import refined_document
    from lumbar.improvement.report import write_diagnosis
    from lumbar.improvement.settings import Settings
    from lumbar.improvement.simulated import compare_and_locate
    from lumbar.pages.diagnosis import diagnosis_page
    from lumbar.pages.diagnosis_pictures import draw_pictures
    from lumbar.records.columns import read_record

    records = [
        read_record(path, params.layout, entry["name"], entry.get("period_s"), params.rate)
        for entry, path in zip(params.records, input.recordings, strict=True)
    ]
    settings, folder = Settings.from_config(params.improvement, params.base), Path(output.diagnosis).parent
    diagnosis = diagnose(records, settings)
    evidence = gather_evidence(diagnosis, records, settings, params.seed, params.machine)
    floor, training = diagnosis.experiment.floor, diagnosis.experiment.floor_from
    simulated = compare_and_locate(records, diagnosis.base.fit, floor, training, params.seed, settings.centre)
    pictures = draw_pictures(diagnosis, simulated, settings.candidates, folder, params.data)
    comparisons = comparison_table([item.comparison for item in simulated], params.data)
    comparisons.write(output.compare.removesuffix(".csv"))
    locations = location_table([item.location for item in simulated], params.data)
    locations.write(output.location.removesuffix(".csv"))
    write_json(output.refined, refined_document(diagnosis.ladder, diagnosis.experiment, params.data))
    page = diagnosis_page(diagnosis, evidence, settings.candidates, params.data, pictures)
    write_text(output.page, page)
    write_diagnosis(diagnosis, evidence, folder, params.data)


run(main, snakemake)
