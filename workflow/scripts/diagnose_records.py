"""What a base model is missing on one record set: diagnosis, refined model, error ladder, where it fails."""

from job import run


def main(input, output, params):
    """Read the records, diagnose them, write the evidence."""
    from pathlib import Path

    from lumbar.interface.diagnosis import diagnose
    from lumbar.interface.reading import read_listed
    from lumbar.settings.improvement import ImprovementSettings
    from lumbar.settings.layout import ColumnLayout, RecordSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.signals import MachineSettings
    from lumbar.settings.tissue import TissueSettings

    listed = [typed(RecordSettings, entry) for entry in params.records]
    records = read_listed(input.recordings, listed, typed(ColumnLayout, params.layout), params.rate)
    diagnosis = diagnose(
        records,
        base=params.base,
        train=params.train,
        session=params.session,
        settings=typed(ImprovementSettings, params.improvement),
        machine=typed(MachineSettings, params.machine),
        tissue=typed(TissueSettings, params.tissue),
        gravity_m_s2=params.gravity,
        seed=params.seed,
        data=params.data,
    )
    diagnosis.save(Path(output.refined).parent, effects=params.effects)


run(main, snakemake)
