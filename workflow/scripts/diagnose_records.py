"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.figures.ladder import ladder_figure, ladder_rungs
    from lumbar.figures.style import save
    from lumbar.files import read_json, write_json
    from lumbar.improvement.compare import comparison_table
    from lumbar.improvement.diagnosis import Settings, diagnose
    from lumbar.improvement.locate import location_table
    from lumbar.improvement.refined_model import refined_document
    from lumbar.improvement.report import write_diagnosis
    from lumbar.improvement.simulated import compare_and_locate
    from lumbar.records.columns import read_record

    records = [
        read_record(path, params.layout, entry["name"], entry.get("period_s"), params.rate)
        for entry, path in zip(params.records, input.recordings, strict=True)
    ]
    settings = Settings.from_config(params.improvement, params.base)
    diagnosis = diagnose(records, settings)
    folder = Path(output.diagnosis).parent
    write_diagnosis(diagnosis, settings.candidates, folder, params.data)
    write_json(output.refined, refined_document(diagnosis.ladder, diagnosis.experiment, params.data))
    content = read_json(output.diagnosis)
    floor, training = diagnosis.experiment.floor, diagnosis.experiment.training.name
    base = diagnosis.base.fit
    comparisons, locations = compare_and_locate(records, base, floor, training, params.seed, settings.centre)
    comparison_table(comparisons, params.data).write(output.compare.removesuffix(".csv"))
    location_table(locations, params.data).write(output.location.removesuffix(".csv"))
    figure = ladder_figure(ladder_rungs(content), content["unit"], content["noise_floor_rms"])
    save(figure, output.ladder_svg.removesuffix(".svg"), params.data)


run(main, snakemake)
