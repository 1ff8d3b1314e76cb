"""One lift: gaps, events, centres of mass and pendulum states of the deposit."""

from job import run


def main(input, output, params):
    """Read the markers, analyse the lift, write what it holds."""
    from lumbar.files import write_csv, write_json
    from lumbar.lifting import lift as lifting
    from lumbar.records.markers import read_markers
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.plain import plain, typed
    from lumbar.settings.subject import SubjectSettings, TrialSettings

    settings = typed(LiftingSettings, params.settings)
    subject, trial = typed(SubjectSettings, params.subject), typed(TrialSettings, params.trial)
    recording = read_markers(input.markers, settings.markers, name=params.lift)
    lift = lifting.analyse_lift(recording, params.lift, subject, trial, settings)
    label = {"data": params.data}
    write_csv(output.centres, lifting.centres_frame(lift).assign(**label))
    write_csv(output.states, lifting.states_frame(lift).assign(**label))
    write_csv(output.gaps, lifting.gaps_frame(lift).assign(**label))
    write_csv(output.motion, lifting.motion_frame(lift).assign(**label))
    write_csv(output.landmarks, lifting.landmarks_frame(lift).assign(**label))
    events = {name: event.as_dict() for name, event in lift.events.items()}
    write_json(
        output.events, {"lift": params.lift, "events": events, "rules": plain(settings.events), **label}
    )
    write_json(output.summary, {**lifting.summary(lift, subject, trial, settings), **label})


run(main, snakemake)
