"""One lift: gaps, events, centres of mass and pendulum states of the deposit."""

from job import run


def main(input, output, params):
    """Read the markers, analyse the lift, write what it holds; warn where that is no pendulum."""
    import sys
    from pathlib import Path

    from lumbar.interface.person import lift
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.subject import SubjectSettings, TrialSettings

    trial = typed(TrialSettings, params.trial)
    found = lift(
        input.markers,
        typed(SubjectSettings, params.subject),
        trial.box_mass_kg,
        trial=trial,
        name=params.lift,
        static=next(iter(input.static), None),
        forces=next(iter(input.forces), None),
        settings=typed(LiftingSettings, params.settings),
        data=params.data,
    )
    found.save(Path(output.summary).parent)
    if not found.analysed.states:
        print(
            "\n".join([f"WARNING: {found.name} has no pendulum:", *found.without_pendulum]), file=sys.stderr
        )


run(main, snakemake)
