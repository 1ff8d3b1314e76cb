"""One lift: gaps, events, centres of mass and pendulum states of the deposit."""

from job import run

from lumbar.settings.lifting import LiftingSettings, SubjectSettings, TrialSettings


def main(
    input,
    output,
    lift: str,
    subject: dict,
    trial: TrialSettings,
    settings: LiftingSettings,
    source_label: str,
):
    """Read the markers, analyse the lift, write its files; warn if it has no pendulum."""
    import sys
    from pathlib import Path

    from lumbar.interface.lift import lift as analyse

    static = next(iter(input.static), None)
    result = analyse(
        input.markers,
        SubjectSettings.model_construct(**subject, experience=""),
        trial=trial,
        name=lift,
        static=static,
        settings=settings,
        source_label=source_label,
    )
    result.save(Path(output.summary).parent)
    if not result.analysed.states:
        print(
            "\n".join([f"WARNING: {result.name} has no pendulum:", *result.missing_pendulums]),
            file=sys.stderr,
        )


run(main, snakemake)
