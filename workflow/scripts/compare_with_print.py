"""Table 3.1 against the print: the twin's tissue tests played again with one thing changed at a time."""

from job import run, stem

from lumbar.settings.study_settings import StudySettings


def main(input, output, settings: StudySettings, data: str):
    """Play and identify every experiment, write the table."""
    import pandas as pd

    from lumbar.base.files import read_json
    from lumbar.publishing.reproduction.table_3_1_experiments import table_3_1_experiments
    from lumbar.tissue.signals.excitation import excited_band

    band = excited_band(read_json(input.bandwidth), settings.signals)
    printed, here = pd.read_csv(input.printed), pd.read_csv(input.here)
    found = table_3_1_experiments(printed, here, settings, band, data)
    found.write(stem(output.table_3_1_experiments))


run(main, snakemake)
