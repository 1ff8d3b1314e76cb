"""Measures of every lift of one person, and what pushes need of it."""

from job import run


def main(input, output, params):
    """Analyse the lifts one after the other; a lift without a result has its reason in the table."""
    from lumbar.base.files import write_csv
    from lumbar.interface.measured_person import measure_person
    from lumbar.settings.lifting import LiftingSettings
    from lumbar.settings.plain import typed
    from lumbar.settings.stability import StabilitySettings
    from lumbar.settings.subject import SubjectSettings, TrialSettings

    analysed = []
    trials = {name: typed(TrialSettings, trial) for name, trial in params.trials.items()}
    table = measure_person(
        dict(zip(trials, input.markers, strict=True)),
        trials,
        typed(SubjectSettings, {"experience": "not said", **params.subject}),
        typed(LiftingSettings, params.lifting),
        typed(StabilitySettings, params.stability),
        static=next(iter(input.static), None),
        data=params.data,
        each=analysed.append,
    )
    write_csv(output.measures, table)
    if params.push_share is not None:
        from lumbar.interface.pushing import push_states

        states = push_states(analysed, typed(StabilitySettings, params.stability), params.push_share)
        write_csv(output.states, states)


run(main, snakemake)
