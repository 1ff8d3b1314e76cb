"""Measures of every lift of one subject."""

from job import run

from lumbar.settings.lifting import LiftingSettings, StabilitySettings, SubjectSettings, TrialSettings


def main(
    input,
    output,
    subject: dict,
    trials: dict[str, TrialSettings],
    lifting: LiftingSettings,
    stability: StabilitySettings,
    source_label: str,
):
    """Analyse the lifts one after the other; a lift without a result has its reason in the table."""
    from lumbar.base.files import write_csv
    from lumbar.interface.movement import measure_person

    table = measure_person(
        dict(zip(trials, zip(input.markers, trials.values(), strict=True), strict=True)),
        SubjectSettings.model_construct(**subject, experience="not said"),
        lifting,
        stability,
        static=next(iter(input.static), None),
        source_label=source_label,
    )
    write_csv(output.measures, table)


run(main, snakemake)
