"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.interface.diagnosis import diagnose
    from lumbar.interface.reading import read_listed
    from lumbar.settings.layout import ColumnLayout, RecordSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.study_settings import StudySettings

    listed = [typed(RecordSettings, entry) for entry in params.records]
    records = read_listed(input.recordings, listed, typed(ColumnLayout, params.layout), params.rate)
    diagnosis = diagnose(
        records,
        settings=typed(StudySettings, params.settings, complete=False),
        data=params.data,
    )
    diagnosis.save(Path(output.refined).parent, effects=params.effects)


run(main, snakemake)
