"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.figures.comparison import comparison_figure
    from lumbar.figures.ladder import ladder_figure, ladder_rungs
    from lumbar.figures.location import location_figure
    from lumbar.figures.style import save
    from lumbar.files import write_json
    from lumbar.improvement.compare import comparison_table
    from lumbar.improvement.diagnosis import Settings, diagnose
    from lumbar.improvement.locate import location_table
    from lumbar.improvement.refined_model import refined_document
    from lumbar.improvement.report import write_diagnosis
    from lumbar.improvement.simulated import compare_and_locate, least_explained
    from lumbar.records.columns import read_record

    records = [
        read_record(path, params.layout, entry["name"], entry.get("period_s"), params.rate)
        for entry, path in zip(params.records, input.recordings, strict=True)
    ]
    settings = Settings.from_config(params.improvement)
    diagnosis = diagnose(records, settings)
    floor, training = diagnosis.experiment.floor, diagnosis.experiment.training.name
    base = diagnosis.base.fit
    simulated = compare_and_locate(records, base, floor, training, params.seed, settings.centre)
    comparisons = [item.comparison for item in simulated]
    shown = least_explained(simulated)
    name = base.structure.base.name
    figure = comparison_figure(shown.record, shown.values, comparisons, name)
    save(figure, output.comparison_svg.removesuffix(".svg"), params.data)
    located = next(item for item in simulated if item.record.name == training)
    save(location_figure(located.location), output.location_svg.removesuffix(".svg"), params.data)
    content = diagnosis.to_json()
    figure = ladder_figure(ladder_rungs(content), content["unit"], content["noise_floor_rms"])
    save(figure, output.ladder_svg.removesuffix(".svg"), params.data)
    comparison_table(comparisons, params.data).write(output.compare.removesuffix(".csv"))
    location_table([item.location for item in simulated], params.data).write(
        output.location.removesuffix(".csv")
    )
    write_json(output.refined, refined_document(diagnosis.ladder, diagnosis.experiment, params.data))
    write_diagnosis(diagnosis, settings.catalogue, Path(output.diagnosis).parent, params.data)


run(main, snakemake)
