"""One lift by the body model: pendulum states with standard deviations, basin areas with intervals."""

from job import run

from lumbar.settings.lifting import LiftingSettings
from lumbar.settings.stability import StabilitySettings
from lumbar.settings.subject import SubjectSettings, TrialSettings


def main(
    input,
    output,
    lift: str,
    subject: SubjectSettings,
    trial: TrialSettings,
    settings: LiftingSettings,
    stability: StabilitySettings,
    data: str,
):
    """Analyse the lift by the rules, fit the body model to its markers, write what comes of it; warn where nothing does."""
    import sys
    from pathlib import Path

    from lumbar.base.errors import InputError
    from lumbar.interface.body_model import save_without_model
    from lumbar.interface.lift import lift as analyse
    from lumbar.lifting.quality.other_trials import other_trials

    beside: dict = {role: next(iter(input[role]), None) for role in ("static", "forces")}
    beside |= {"others": other_trials(input.others, settings.markers, subject.height_m)}
    found = analyse(input.markers, subject, trial=trial, name=lift, **beside, settings=settings, data=data)
    folder = Path(output.areas).parent
    try:
        found.body_model(stability).save(folder)
    except InputError as error:
        save_without_model(folder)
        print(f"WARNING: {found.name} has no body model: {error}", file=sys.stderr)


run(main, snakemake)
