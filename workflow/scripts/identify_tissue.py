"""Identification of every tissue model on one training record."""

from job import run


def main(input, output, params):
    """Read the records, identify the models, write fits and search grid."""
    import pandas as pd

    from lumbar.files import write_csv, write_json
    from lumbar.records.columns import read_record
    from lumbar.tissue.identification import Settings, identify
    from lumbar.tissue.models_file import inverted_linear_fit

    tissue = params.tissue
    records = {
        entry["name"]: read_record(
            path, tissue["layout"], entry["name"], entry.get("period_s"), tissue["rate_Hz"]
        )
        for entry, path in zip(tissue["records"], input.recordings, strict=True)
    }
    training = records.pop(params.training)
    tests = list(records.values())
    result = identify(training, tests, Settings.from_config(tissue), params.seed)
    given = inverted_linear_fit(training, tests, tissue["settling_s"], **tissue["inverted_linear"])
    result["fits"].append(given)
    if params.improvement["effects"]:
        from lumbar.improvement.published import refined_fit
        from lumbar.improvement.settings import Settings as Improvement

        settings = Improvement.from_config(params.improvement, train=training.name)
        result["fits"].append(refined_fit([training, *tests], params.improvement["effects"], settings))
    write_csv(output.grid, pd.DataFrame(result.pop("grid")).assign(data=params.data))
    write_json(output.fits, {**result, "data": params.data})


run(main, snakemake)
