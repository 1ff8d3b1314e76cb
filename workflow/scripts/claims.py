"""Compare every claim of the thesis with the results of this run."""

from pathlib import Path

from job import run, stem


def main(input, output, names: list[str], groups: list[str], synthetic: bool, source_label: str):
    """Read the published tables and this run's results, examine all claims, write them."""
    import pandas as pd

    from lumbar.base.files import read_json, write_csv
    from lumbar.publishing.reproduction.claims import all_claims, examine_claims, summary_table

    published = {Path(path).stem: pd.read_csv(path) for path in input.published}
    results = {
        name: read_json(path) if path.endswith(".json") else pd.read_csv(path)
        for name, path in zip(names, input.results, strict=True)
    }
    claims = all_claims(published, tuple(groups))
    claims = examine_claims(claims, results, synthetic, source_label)
    write_csv(output.claims, claims)
    summary_table(claims, source_label).write(stem(output.claims_table))


run(main, snakemake)
