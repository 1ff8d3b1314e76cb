"""Missing effects of a base model on one record set: diagnosis, refined model, error ladder, places of the error."""

from job import run

from lumbar.settings.layout import RecordSettings
from lumbar.settings.study_settings import StudySettings


def main(
    input,
    output,
    records: tuple[RecordSettings, ...],
    base: str,
    settings: StudySettings,
    effects: tuple[str, ...] | None,
    source_label: str,
):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    import lumbar
    from lumbar.interface.reading import read_listed

    read = read_listed(input.recordings, records, settings.tissue.layout, settings.tissue.rate_Hz)
    diagnosis = lumbar.diagnose(read, base=base, settings=settings, source_label=source_label)
    diagnosis.save(Path(output.refined).parent, effects=effects)


run(main, snakemake)
