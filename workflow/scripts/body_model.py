"""One lift by the body model: pendulum states with standard deviations, basin areas with intervals."""

from job import run


def main(input, output, params):
    """Analyse the lift by the rules, fit the body model to its markers, write what comes of it; warn where nothing does."""
    import sys
    from pathlib import Path

    from lumbar.base.errors import InputError
    from lumbar.interface.body_model import save_without_model
    from lumbar.interface.person import lift
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
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
    folder = Path(output.areas).parent
    try:
        found.body_model(typed(StabilitySettings, params.stability)).save(folder)
    except InputError as error:
        save_without_model(folder)
        print(f"WARNING: {found.name} has no body model: {error}", file=sys.stderr)


run(main, snakemake)
